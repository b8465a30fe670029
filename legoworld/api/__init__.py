"""The API behind `import legoworld`, on which the commands are built. See docs/python.md."""

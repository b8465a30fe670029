"""What `import legoworld` offers; the commands are written with it. See docs/python.md."""

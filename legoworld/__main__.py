"""`python -m legoworld`."""

from legoworld.cli import entry

if __name__ == "__main__":
    entry()

"""The compiled loops of evaluation and the library they are loaded from."""

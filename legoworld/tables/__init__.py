"""Tables as values, and one renderer for each target: terminal, HTML, CSV, LaTeX, Markdown."""

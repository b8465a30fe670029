"""The questions a scene can be asked, as values: tasks, their families, one registry."""

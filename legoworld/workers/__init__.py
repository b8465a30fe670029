"""Child processes: their environment, their sandbox, and how they are ended."""

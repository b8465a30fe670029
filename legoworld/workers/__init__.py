"""Child processes: what they are given, what confines them, and how they are ended."""

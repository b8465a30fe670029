"""What happened on the way to a scene: transcripts, scenes over time, and their diagnostics."""

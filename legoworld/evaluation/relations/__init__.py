"""Questions about a picture: asked of facts, answered, and scored against what is true."""

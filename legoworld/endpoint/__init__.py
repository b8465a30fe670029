"""A headless Blender that speaks Blender MCP's socket protocol: its calls and its scenes."""

"""Reading scene.glb without Blender: container, accessors, nodes, alpha, cameras, snapshot."""

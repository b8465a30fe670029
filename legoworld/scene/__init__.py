"""The scene side: scene folders, freezing, snapshots, labels. Only `blender/` imports bpy."""

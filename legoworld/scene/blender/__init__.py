"""The only package that imports bpy. It runs in worker processes only; see `worker`."""

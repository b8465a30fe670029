"""Cameras out of the files of others: COLMAP, nerfstudio and NeRF, BlenderProc and BOP."""

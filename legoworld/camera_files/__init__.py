"""Cameras out of the files of others: COLMAP, nerfstudio and NeRF, BlenderProc (text and .hdf5) and BOP."""

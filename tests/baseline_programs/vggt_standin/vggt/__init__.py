"""A stand-in for facebookresearch/vggt: its interface and shapes, a small network of another make.

The real package is on no index and was not at hand. What is alike was read in its source: the
arguments of `VGGT`, the names of its parts, what goes into `forward` and comes out, and what the
nine numbers of a pose mean. The layers are not alike, so real weights do not fit.
"""

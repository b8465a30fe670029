"""legoworld reads COCO boxes, LVIS masks and depth out of a frozen Blender scene."""

__version__ = "0.1.0"

"""The plugin: measures a live scene against evidence from the photo, and guards edits to it.

It never reads ground truth. What it measures comes from a saved copy of the live scene, read by the
same worker as every readout.
"""

"""The viewer napari: opens results, and solves measurements. The manifest is ``napari.yaml``."""

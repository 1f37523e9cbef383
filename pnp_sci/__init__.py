"""Plug-and-play reconstruction for snapshot compressive imaging.

Public names are loaded on first use, so that ``import pnp_sci`` is quick and never loads torch or compiles anything.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

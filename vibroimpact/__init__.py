"""A forced oscillator with impacts: one motion, many motions at once, and periodic orbits."""

import os

import lazy_loader

__version__ = "0.1.0"

if not os.path.isfile(__file__):
    raise ImportError(
        f"{os.path.dirname(os.path.dirname(__file__))} is no folder: vibroimpact is compiled from "
        "files, and not from a ZIP; unpack it to a folder of the path, or install it with pip",
        name=__name__,
    )

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

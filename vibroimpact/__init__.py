"""A forced oscillator with impacts: one motion, many motions at once, and periodic orbits."""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

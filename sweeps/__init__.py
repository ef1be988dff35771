"""The sweep engine: a YAML configuration in, an HDF5 file and pictures out."""

import lazy_loader

from vibroimpact import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

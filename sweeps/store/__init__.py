"""The HDF5 file of a sweep: its content, and how it is created, written, verified and read.

Only this room imports h5py. The names that other rooms use are listed here and imported on first
use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

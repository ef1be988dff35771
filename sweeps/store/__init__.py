"""The file of a sweep: its content, and how it is created, verified and read.

Only this room imports h5py. The names that other rooms use are listed here and imported on first
use.
"""

import lazy_loader

import vibroimpact  # noqa: F401 - in a ZIP it says what to do

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""What recorded motions are: kinds, classes m/q and where they change, attractors and their tables.

It reads opened sweeps; how they were computed and how they are drawn is not known here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

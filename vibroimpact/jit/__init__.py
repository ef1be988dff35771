"""How functions are compiled, and kept on disk; which parts of numba are used."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

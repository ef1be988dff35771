"""Pictures of an opened sweep; each is drawn by a function that returns a matplotlib Figure.

``plot`` writes the picture of a kind into a file; ``KINDS`` names the kinds. Beside
`sweeps.bench`, only this room imports matplotlib.
"""

from sweeps.errors import Refused

try:
    import matplotlib  # noqa: F401
except ValueError as error:  # of MPLBACKEND, which no picture needs
    raise Refused(
        f"matplotlib cannot work with its settings: {error}; unset or correct MPLBACKEND"
    ) from None


import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

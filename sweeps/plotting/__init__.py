"""Pictures of an opened sweep, each a matplotlib Figure.

``plot`` writes a picture of one of the ``KINDS`` to a file. Only this room and `sweeps.bench`
import matplotlib.
"""

from sweeps.errors import Refused

try:
    import matplotlib  # noqa: F401
except ValueError as error:  # an invalid MPLBACKEND, though no picture uses it
    raise Refused(
        f"matplotlib cannot work with its settings: {error}; unset or correct MPLBACKEND"
    ) from None


import lazy_loader

import vibroimpact  # noqa: F401 - in a ZIP it says what to do

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

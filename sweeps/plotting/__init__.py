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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.plotting.attractor_pictures import attractor_diagram as attractor_diagram
    from sweeps.plotting.attractor_pictures import basins as basins
    from sweeps.plotting.bifurcation_diagram import bifurcation as bifurcation
    from sweeps.plotting.canvas import Page as Page
    from sweeps.plotting.kinds import KINDS as KINDS
    from sweeps.plotting.kinds import plot as plot
    from sweeps.plotting.maps import parameter_map as parameter_map
    from sweeps.plotting.point import impacts as impacts
    from sweeps.plotting.point import section as section
    from sweeps.plotting.trajectory_picture import trajectory as trajectory

_HOME = {
    "KINDS": "kinds",
    "Page": "canvas",
    "attractor_diagram": "attractor_pictures",
    "basins": "attractor_pictures",
    "bifurcation": "bifurcation_diagram",
    "impacts": "point",
    "parameter_map": "maps",
    "plot": "kinds",
    "section": "point",
    "trajectory": "trajectory_picture",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``vibroimpact --help`` does not wait for matplotlib."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)

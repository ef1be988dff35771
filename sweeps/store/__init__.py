"""The HDF5 file of a sweep: what it holds, how it is created, written, verified and read.

Only this room imports h5py. What the others use of it is listed here, and imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.store.blocks import Lost as Lost
    from sweeps.store.layout import ADDED as ADDED
    from sweeps.store.layout import Layout as Layout
    from sweeps.store.lock import only_writer as only_writer
    from sweeps.store.output import check_output as check_output
    from sweeps.store.reader import open_sweep as open_sweep
    from sweeps.store.reader import status_counts as status_counts
    from sweeps.store.variables import DIRECTION as DIRECTION
    from sweeps.store.variables import VARIABLES as VARIABLES
    from sweeps.store.variables import bytes_per_point as bytes_per_point
    from sweeps.store.variables import is_remarkable as is_remarkable
    from sweeps.store.writer import SweepWriter as SweepWriter
    from sweeps.store.writer import sweep_writer as sweep_writer

_HOME = {
    "ADDED": "layout",
    "DIRECTION": "variables",
    "Layout": "layout",
    "Lost": "blocks",
    "SweepWriter": "writer",
    "VARIABLES": "variables",
    "bytes_per_point": "variables",
    "check_output": "output",
    "is_remarkable": "variables",
    "only_writer": "lock",
    "open_sweep": "reader",
    "status_counts": "reader",
    "sweep_writer": "writer",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use: `sweeps.store.variables` needs neither h5py nor xarray."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)

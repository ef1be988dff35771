"""The run of a sweep: plan, compute, follow, refine, workers, cluster.

Only this room imports Dask.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.engine.plan import Estimate as Estimate
    from sweeps.engine.plan import estimate as estimate
    from sweeps.engine.run import run_sweep as run_sweep

_HOME = {"Estimate": "plan", "estimate": "plan", "run_sweep": "run"}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, since the kernel takes a while to load."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)

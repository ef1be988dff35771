"""The sweep engine: a YAML configuration in, an HDF5 file and pictures out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.analysis.distinct_attractors import attractors as attractors
    from sweeps.analysis.exact_branches import branches as branches
    from sweeps.analysis.exact_curves import curves as curves
    from sweeps.config.loading import load_config as load_config
    from sweeps.config.sweep import SweepConfig as SweepConfig
    from sweeps.engine.run import run_sweep as run_sweep
    from sweeps.errors import ConfigError as ConfigError
    from sweeps.errors import StoreError as StoreError
    from sweeps.store import open_sweep as open_sweep

_HOME = {
    "ConfigError": "sweeps.config.loading",
    "StoreError": "sweeps.errors",
    "SweepConfig": "sweeps.config.sweep",
    "attractors": "sweeps.analysis.distinct_attractors",
    "branches": "sweeps.analysis.exact_branches",
    "curves": "sweeps.analysis.exact_curves",
    "load_config": "sweeps.config.loading",
    "open_sweep": "sweeps.store.reader",
    "run_sweep": "sweeps.engine.run",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``vibroimpact --help`` needs neither numba nor xarray."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)

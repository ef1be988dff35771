"""The sweep engine: a YAML configuration in, an HDF5 file and pictures out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.coexisting import attractors as attractors
    from sweeps.config import SweepConfig as SweepConfig
    from sweeps.errors import StoreError as StoreError
    from sweeps.loading import ConfigError as ConfigError
    from sweeps.loading import load_config as load_config
    from sweeps.runner import run_sweep as run_sweep
    from sweeps.store import open_sweep as open_sweep

_HOME = {
    "ConfigError": "sweeps.loading",
    "StoreError": "sweeps.errors",
    "SweepConfig": "sweeps.config",
    "attractors": "sweeps.coexisting",
    "load_config": "sweeps.loading",
    "open_sweep": "sweeps.store",
    "run_sweep": "sweeps.runner",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``vibroimpact --help`` needs neither numba nor xarray."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)

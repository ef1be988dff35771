from . import plotting as plotting
from .attractor.attractors import attractors as attractors
from .attractor.integrity import integrity as integrity
from .attractor.knocks import knocks as knocks
from .bifurcation.bifurcation_table import bifurcations as bifurcations
from .bifurcation.exact_branches import branches as branches
from .bifurcation.exact_curves import curves as curves
from .config.loading import ConfigError as ConfigError
from .config.loading import load_config as load_config
from .config.sweep import SweepConfig as SweepConfig
from .engine.sweep_run import run_sweep as run_sweep
from .errors import Failed as Failed
from .errors import Refused as Refused
from .errors import StoreError as StoreError
from .explorer import explore as explore
from .store.xarray_engine import open_sweep as open_sweep

__version__: str

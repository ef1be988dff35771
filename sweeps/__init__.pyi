from . import plotting as plotting
from .analysis.attractors import attractors as attractors
from .analysis.bifurcations import bifurcations as bifurcations
from .analysis.exact_branches import branches as branches
from .analysis.exact_curves import curves as curves
from .analysis.integrity import integrity as integrity
from .analysis.knocks import knocks as knocks
from .config.loading import ConfigError as ConfigError
from .config.loading import load_config as load_config
from .config.sweep import SweepConfig as SweepConfig
from .engine.run import run_sweep as run_sweep
from .errors import Failed as Failed
from .errors import Refused as Refused
from .errors import StoreError as StoreError
from .explorer import explore as explore
from .store.reading import open_sweep as open_sweep

__version__: str

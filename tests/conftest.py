"""Make ``naive.py`` importable for all tests, and select campaigns only by name.

Campaigns of thousands of cases run only if ``-m`` names them.
"""

import importlib.util
import signal
import sys
from pathlib import Path

# In a background job of a shell, Ctrl-C is ignored. The processes that the tests interrupt would
# inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# By path: with tests/ on sys.path, tests/vibroimpact would shadow the package.
_spec = importlib.util.spec_from_file_location("naive", Path(__file__).parent / "naive.py")
sys.modules["naive"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(sys.modules["naive"])


def pytest_collection_modifyitems(config, items):
    """Deselect the campaigns unless ``-m`` names them."""
    if "campaign" not in config.getoption("markexpr"):
        campaigns = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in set(campaigns)]

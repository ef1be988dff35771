"""The slow implementation beside this file, for all tests, and the campaigns, which run by name.

Campaigns of thousands of cases run only where ``-m`` names them.
"""

import importlib.util
import signal
import sys
from pathlib import Path

# A shell that starts the tests behind a job ignores Ctrl-C, and would hand that on to the processes
# that the tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# By path: with tests/ on sys.path, tests/vibroimpact would shadow the package.
_spec = importlib.util.spec_from_file_location("naive", Path(__file__).parent / "naive.py")
sys.modules["naive"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(sys.modules["naive"])


def pytest_collection_modifyitems(config, items):
    """Leave the campaigns out, also where ``-m "not slow"`` asks for something else."""
    if "campaign" not in config.getoption("markexpr"):
        campaigns = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in set(campaigns)]

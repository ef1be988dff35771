"""The order of the files, campaigns only where ``-m`` names them, and a short search for knocks."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest

# In a background job of a shell, Ctrl-C is ignored. The processes that the tests interrupt would
# inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # until all modules are imported, of which none is garbage

# Where an image sets this, every process would compile all modules anew, and rewrite their asserts.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

pytest.register_assert_rewrite("tests.helpers")


TESTS = Path(__file__).parent
#: The files that run first: two that compile, each another half of the physics, and those that take
#: longest, so that no process is left with one at the end.
EARLY = [
    TESTS / name
    for name in (
        "vibroimpact/test_branches.py",
        "vibroimpact/test_diagnostics.py",
        "sweeps/explorer/test_page.py",
        "vibroimpact/test_jit.py",
        "sweeps/plotting/test_pictures.py",
        "sweeps/bifurcation/test_bifurcations.py",
        "sweeps/engine/test_kill.py",
        "sweeps/cli/test_cluster.py",
        "sweeps/attractor/test_integrity.py",
        "sweeps/engine/test_cluster.py",
        "sweeps/cli/test_commands.py",
        "sweeps/cli/test_systems.py",
        "sweeps/cli/test_environment.py",
    )
]
assert all(path.exists() for path in EARLY)


def pytest_xdist_auto_num_workers(config):
    """Return the number of processes for ``-n auto``: one also works while another waits."""
    return len(os.sched_getaffinity(0)) + 1 if hasattr(os, "sched_getaffinity") else None


def pytest_collection_modifyitems(config, items):
    """Put the files of `EARLY` first, and deselect the campaigns unless ``-m`` names them."""
    place = {path: number for number, path in enumerate(EARLY)}
    items.sort(key=lambda item: place.get(item.path, len(EARLY)))
    if "campaign" not in config.getoption("markexpr"):
        campaigns = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in set(campaigns)]


def pytest_collection_finish():
    """Look for garbage less often, and not among the modules."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(200_000)


@pytest.fixture(autouse=True, scope="session")
def few_knocks():
    """Try a tenth of the usual knocks; sweeps/attractor/test_integrity.py tests their number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sweeps.attractor.knocks._MOMENTS", 12)
        patch.setattr("sweeps.attractor.knocks._SIZES", 64)
        patch.setattr("sweeps.attractor.knocks._CLOSER", 2)
        yield

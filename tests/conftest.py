"""Campaigns of thousands of cases run only if ``-m`` names them."""

import signal

import pytest

# In a background job of a shell, Ctrl-C is ignored. The processes that the tests interrupt would
# inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest.register_assert_rewrite("tests.helpers")


def pytest_collection_modifyitems(config, items):
    """Deselect the campaigns unless ``-m`` names them."""
    if "campaign" not in config.getoption("markexpr"):
        campaigns = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in set(campaigns)]

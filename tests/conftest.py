"""Campaigns of thousands of cases run only where ``-m`` names them."""


def pytest_collection_modifyitems(config, items):
    """Leave the campaigns out, also where ``-m "not slow"`` asks for something else."""
    if "campaign" not in config.getoption("markexpr"):
        campaigns = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in set(campaigns)]

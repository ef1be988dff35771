"""The race of every benchmark, and the final table."""

import pytest

from tests.benchmarks.limits import Race

_RATIOS = pytest.StashKey()


def pytest_configure(config):
    config.stash[_RATIOS] = []


@pytest.fixture
def race(benchmark, request):
    """Return the race of a test against its reference, see ``limits.Race``."""
    return Race(benchmark, request.config.stash[_RATIOS])


def pytest_terminal_summary(terminalreporter, config):
    """Print the measured ratios beside their limits."""
    ratios = config.stash[_RATIOS]
    if ratios:
        terminalreporter.section("speed")
        width = max(len(name) for name, _, _ in ratios)
        terminalreporter.write_line(f"{'':{width}}     now   limit  ratio")
        for name, ratio, limit in ratios:
            line = f"{name:{width}}{ratio:8.3g}{limit:8.3g}{ratio / limit:7.0%}"
            terminalreporter.write_line(line, red=ratio > limit)

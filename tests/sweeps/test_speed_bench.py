"""The speed of the machine: what is measured adds up, and the command shows it."""

import numpy as np
import pytest

from commands import call
from sweeps.bench import speed

SPEEDS = {
    "plain": speed.Speed(100, {1: 30e6, 2: 57e6}, 0.4),
    "exact, chatter": speed.Speed(116, {1: 0.3e6, 2: 0.6e6}, 0.0048),
}


@pytest.fixture
def small(monkeypatch):
    """One work of one block, and a peak that takes no time."""
    monkeypatch.setattr(speed, "WORKS", {"exact": {}})
    monkeypatch.setattr(speed, "_TIMES", 500)


def test_the_share_follows_from_rate_steps_and_peak(small):
    peak, speeds = speed.measure(count=30, periods=150)
    (exact,) = speeds.values()
    assert exact.steps == 12
    assert exact.share == pytest.approx(exact.periods[1] * 12 * 8 / peak)
    assert 0.0 < exact.share < 1.0


def test_the_peak_loop_adds_and_multiplies():
    """Its fixed point is 1; from 0 it comes as near as 0.999^n."""
    sums = np.zeros(speed._SUMS)
    speed._multiply_adds(sums, 100)
    np.testing.assert_allclose(sums, 1.0 - 0.999 ** (100 * speed._CHAIN), rtol=1e-12)


def test_the_command(monkeypatch):
    monkeypatch.setattr(
        "sweeps.bench.speed.measure", lambda count, periods, progress: (58e9, SPEEDS)
    )
    done = call("bench", "speed", "--quick")
    assert done.exit_code == 0, done.stderr
    assert "58e9 multiply-adds" in done.stdout
    (row,) = [line.split() for line in done.stdout.splitlines() if "plain" in line]
    assert row == ["plain", "100", "30", "57", "1.90", "40.0%"]


def test_one_core_has_no_speed_up():
    text = speed.shown(58e9, {"plain": speed.Speed(100, {1: 30e6}, 0.4)})
    (header,) = [line for line in text.splitlines() if line.startswith("impact rule")]
    assert header.split("  ") == ["impact rule", "steps", "one thread", "of peak"]

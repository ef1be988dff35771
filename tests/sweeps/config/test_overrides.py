"""Overrides of a configuration, as by --set: their order, and each error told as one of them."""

import pytest

from tests.helpers.configurations import EXAMPLE, load, refusal

# --set


def test_overrides_replace_and_add_in_order():
    numbers = "oscillator.h=0.2", "oscillator.omega.num=7", "start.v0=[1, 2]"
    config = load(EXAMPLE, *numbers, "record.trajectory={every: 2}", "name=renamed")
    assert config.oscillator.h == 0.2
    assert config.sweep.grid.shape == (7, 2)
    assert config.record.trajectory and config.record.trajectory.every == 2
    assert config.name == "renamed"


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("oscillator.R=1.2", ["oscillator.R = 1.2", "from 0 to 1"]),
        ("oscilator.h=1", ["unknown key oscilator", "did you mean oscillator?"]),
        ("oscillator.omga=1", ["oscillator.omga", "did you mean omega?", "clearance"]),
        ("oscillator.h.num=2", ["oscillator.h = 0.1 has no keys"]),
        ("oscillator.h=[1,", ["not valid YAML"]),
        ("oscillator.h", ["expected key=value"]),
        ("oscillator.h=", ["oscillator.h = (nothing) is not a number"]),
        ("oscillator.h=0,1", ["oscillator.h = 0,1 has a decimal comma", "decimal point, no comma"]),
        ("oscillator={h: 0,1, R: 1}", ["unknown key oscillator.1 (", "decimal point, no comma"]),
        ("record.trajectory={ever: 2}", ["record.trajectory.ever (did you mean every?)"]),
        ("oscillator={h: 1, h: 2}", ["h: 2}: oscillator.h is given twice, first in override"]),
        ("oscillator={? {a: 1, a: 2} : 1}", ["a list or mapping is not allowed as a key"]),
        ("record.trajectory=yes", ["record.trajectory = yes is not allowed"]),
        ("record.trajectory={}", ["record.trajectory.every is missing"]),
        ("a..b=1", ["expected key=value"]),
        ("<scalar>=1", ["unknown key <scalar>"]),
    ],
)
def test_a_wrong_override_is_reported_as_one(override, parts):
    message = refusal(EXAMPLE.replace("false", "{every: 1}"), [override])
    for line in message.splitlines():
        assert line.startswith(f"override {override}")
    for part in parts:
        assert part in message

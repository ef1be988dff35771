"""Configurations: valid ones, and the messages for invalid ones."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml

from sweeps import load_config
from sweeps.errors import ConfigError

EXAMPLE = """\
name: frequency-bifurcation
oscillator: {h: 0.1, R: 0.8, omega: {start: 0.8, stop: 4.0, num: 4096}, f: 1.0}
start: {x0: 0.0, v0: 0.0}
method: {integrator: exact, impact: exact, steps_per_period: null}
output: results/frequency.h5
record: {transient: 1000, periods: 100, phase: 0.0, impacts: 64, trajectory: false,
         diagnostics: [period]}
"""


OSCILLATOR = {"h": "0.1", "R": "0.8", "omega": "2.0", "f": "1.0"}


def refusal(text, overrides=()):
    """Return the message for a configuration that must be refused."""
    with pytest.raises(ConfigError) as caught:
        load(text, *overrides)
    message = str(caught.value)
    for jargon in ("Input should", "type=", "input_value", "errors.pydantic.dev", "<mapping>"):
        assert jargon not in message
    return message


def oscillator_yaml(**values):
    """Return a one-line configuration with these values; the others are valid."""
    items = ", ".join(f"{name}: {value}" for name, value in (OSCILLATOR | values).items())
    return f"oscillator: {{{items}}}\n"


#: Over starts, with several attractors.
OVER_STARTS = """\
oscillator: {h: 0.0, R: 0.8, omega: 1.3, f: 1.0}
start: {x0: {start: -2.4, stop: 0.0, num: 9}, v0: {start: -2.0, stop: 2.0, num: 9}}
record: {transient: 400, periods: 32, impacts: 12, diagnostics: [period, lyapunov]}
"""


def linear_values(start, stop, num):
    """Return the numbers nearest to those of a linear axis of decimal numbers."""
    first, last = Fraction(repr(start)), Fraction(repr(stop))
    return np.array([float(first + (last - first) * i / (num - 1)) for i in range(num)])


def load(configuration, *overrides, path="sweep.yaml"):
    """Write a configuration, given as text or mapping, to a file, and load that file."""
    if not isinstance(configuration, str):
        configuration = yaml.safe_dump(configuration, sort_keys=False)
    Path(path).write_text(configuration, encoding="utf-8")
    return load_config(path, overrides)

"""One valid configuration, and the message with which another one is refused."""

import pytest

from sweep_files import load
from sweeps.errors import ConfigError

EXAMPLE = """\
name: frequency-bifurcation
oscillator: {h: 0.1, R: 0.8, omega: {start: 0.8, stop: 4.0, num: 4096}, f: 1.0}
start: {x0: 0.0, v0: 0.0}
method: {integrator: exact, impact: exact, steps_per_period: null}
record: {transient: 200, periods: 100, phase: 0.0, impacts: 64, trajectory: false, diagnostics: []}
output: results/frequency.h5
"""


OSCILLATOR = {"h": "0.1", "R": "0.8", "omega": "2.0", "f": "1.0"}


def refusal(text, overrides=()):
    """Return the message with which a text is refused."""
    with pytest.raises(ConfigError) as caught:
        load(text, *overrides)
    message = str(caught.value)
    for jargon in ("Input should", "type=", "input_value", "errors.pydantic.dev", "<mapping>"):
        assert jargon not in message
    return message


def oscillator(**values):
    """Return a configuration of one line with these values among valid ones."""
    items = ", ".join(f"{name}: {value}" for name, value in (OSCILLATOR | values).items())
    return f"oscillator: {{{items}}}\n"

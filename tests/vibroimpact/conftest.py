"""Certified orbits, for the tests of the physics."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.kernel_cases import EVERY_METHOD
from vibroimpact import Oscillator

TESTS = Path(__file__).parents[1]


def pytest_generate_tests(metafunc):
    """Run a test of `integrator` and `rule` for ``EVERY_METHOD`` unless it chooses others."""
    marks = metafunc.definition.iter_markers("parametrize")
    chosen = {name for mark in marks for name in re.split(r"\W+", str(mark.args[0]))}
    if {"integrator", "rule"} <= set(metafunc.fixturenames) and not chosen & {"integrator", "rule"}:
        ids = ["-".join(method) for method in EVERY_METHOD]
        metafunc.parametrize(("integrator", "rule"), EVERY_METHOD, ids=ids)


@dataclass(frozen=True)
class Orbit:
    """One certified orbit: its oscillator, its start and its certified values."""

    oscillator: Oscillator
    x0: float
    v0: float
    impact_t: np.ndarray
    impact_v: np.ndarray
    sections: np.ndarray
    rests: np.ndarray


def _orbit(case):
    given = {name: float(value) for name, value in case["params"].items()}
    x0, v0 = given.pop("x0"), given.pop("v0")
    rests = [(float(r["accumulation_t"]), float(r["release_t"])) for r in case["rests"]]
    impacts = (np.array(case[name], float) for name in ("impact_t", "impact_v"))
    sections = np.array([(float(s["x"]), float(s["v"])) for s in case["section"]])
    return Orbit(Oscillator(**given), x0, v0, *impacts, sections, np.array(rests).reshape(-1, 2))


@pytest.fixture(scope="session")
def truth():
    """Return the orbits of tests/truth/orbits.json by name."""
    cases = json.loads((TESTS / "truth" / "orbits.json").read_text())["cases"]
    return {case["name"]: _orbit(case) for case in cases}

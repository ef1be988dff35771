"""Certified orbits, and the slow implementation next door, for the tests of the physics."""

import importlib.util
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from vibroimpact import Oscillator

TESTS = Path(__file__).parents[1]

# By path: with tests/ on sys.path, tests/vibroimpact would shadow the package.
_spec = importlib.util.spec_from_file_location("naive", TESTS / "naive.py")
sys.modules["naive"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(sys.modules["naive"])


@dataclass(frozen=True)
class Orbit:
    """One certified orbit: its oscillator and start, and what is known of it."""

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
    return Orbit(
        Oscillator(**given),
        x0,
        v0,
        np.array(case["impact_t"], float),
        np.array(case["impact_v"], float),
        np.array([(float(s["x"]), float(s["v"])) for s in case["section"]]),
        np.array(rests).reshape(-1, 2),
    )


@pytest.fixture(scope="session")
def truth():
    """The orbits of tests/truth/orbits.json, by name."""
    cases = json.loads((TESTS / "truth" / "orbits.json").read_text())["cases"]
    return {case["name"]: _orbit(case) for case in cases}

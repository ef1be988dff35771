"""Attractors, their measures and knocks in other units: units of a power of two change no bit."""

import numpy as np
import pytest

from sweeps import integrity, knocks, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.other_units import in_units

#: 1 / time and length of the other units.
OTHERS = [(2.0**-20, 2.0**-40), (2.0**10, 2.0**5), (1.0, 2.0**30)]


def random_scene(random, step):
    """Return the parameters and starts of a random oscillator, at three values of omega."""
    clearance = random.choice([0.0, random.uniform(-0.5, 1.0)])
    return {
        "h": 10.0 ** random.uniform(-2.3, -0.5), "R": random.uniform(0.3, 0.95), "f": 1.0,
        "omega": random.uniform(0.8, 3.5) * (1.0 + step * np.arange(3)),
        "p": random.uniform(0.8, 1.2), "clearance": clearance,
        "x0": clearance + np.linspace(-2.5, 0.0, 10), "v0": np.linspace(-2.0, 2.0, 11),
    }  # fmt: skip


def found_in(scene, rate, length, phase, path):
    """Return what is found, by name, with rate and length as the units of 1 / time and length."""
    values = {name: in_units(name, value, rate, length) for name, value in scene.items()}
    config = {
        "start": {"x0": values.pop("x0"), "v0": values.pop("v0"), "phase": phase},
        "oscillator": values,
        "record": {"transient": 60, "periods": 32, "phase": phase, "diagnostics": ["period"]},
    }
    with open_sweep(run_sweep(config, path, overwrite=True)) as dataset:
        found, starts = integrity(dataset), dataset.isel(omega=0)
        knocked = knocks(starts, found.isel(omega=0))
        results = {name: found[name].values for name in found}
        results |= {name: knocked[name].values for name in knocked if "knock" in name}
        rows = attractor_rows(OpenedSweep(dataset), found)
        results["speeds"] = np.concatenate([row.speeds for row in rows])
    return results


#: Random sets of attractors, with the other units for each; of the first, an orbit of two periods
#: is reached at both phases.
CASES = [
    (9, OTHERS[:1]),
    pytest.param(2, OTHERS[2:], marks=pytest.mark.slow),
    *(pytest.param(n, OTHERS, marks=pytest.mark.campaign) for n in range(1, 33)),
]


@pytest.mark.parametrize(("seed", "units"), CASES)
def test_units_of_a_power_of_two_change_no_bit(seed, units, tmp_path):
    random = np.random.default_rng(seed)
    step = (0.15, 0.01)[seed % 2]  # far enough that seeds are needed, or not
    scene, phase = random_scene(random, step), random.choice([0.0, random.uniform(0.0, 6.0)])
    expected = found_in(scene, 1.0, 1.0, phase, tmp_path / "a.h5")
    assert expected["attractors"].all()
    for rate, length in units:
        found = found_in(scene, rate, length, phase, tmp_path / "b.h5")
        for name, values in expected.items():
            wanted = in_units(name, values, rate, length)
            np.testing.assert_array_equal(found[name], wanted, err_msg=name)

"""The classes beside a bifurcation in the list: such motions exist there, as simulations find."""

import numpy as np
import pytest

import sweeps
from vibroimpact import Oscillator, integrate

pytestmark = pytest.mark.slow

#: Ranges of the parameters in which most motions have impacts.
RANGES = {
    "h": (0.01, 0.3), "R": (0.4, 0.95), "omega": (2.2, 3.3), "f": (0.7, 1.3), "p": (0.7, 1.3),
    "clearance": (0.02, 0.3),
}  # fmt: skip
#: The case that was wrong: 8/7 ends in a fold before the graze at which 4/3 begins.
CASE = {
    "R": 0.7885194416827579, "omega": 2.716989975262034, "f": 1.0, "clearance": 0.14602287303658285,
    "h": np.linspace(0.0, 0.3, 140).tolist(),
}  # fmt: skip
#: Distance from a bifurcation at which a motion must exist, as a share of the steps of the axis, if
#: no value of the sweep and no other bifurcation is as near: then half the way to that.
BESIDE = 1e-2


def run(tmp_path, axis, oscillator):
    """Run a sweep from rest; return it, and the bifurcations along its axis."""
    record = {"transient": 200, "periods": 64, "diagnostics": ["period"]}
    scene = {"oscillator": oscillator, "start": {"x0": 0.0}, "record": record}
    path = sweeps.run_sweep(scene, tmp_path / "out.h5", overwrite=True)
    with sweeps.open_sweep(path) as dataset:
        return dataset.load(), sweeps.bifurcations(dataset, axis, most=1)


def settled(oscillator, state, transient):
    """Continue a motion; return its last state, its periods and its impacts in a repetition."""
    points = oscillator.at()
    points["x0"], points["v0"] = min(state[0], oscillator.clearance), state[1]
    record = integrate(points, transient=transient, periods=64, at_section=True)
    sections = np.stack([record["poincare_x"][0], record["poincare_v"][0]], axis=1)
    for m in range(1, 33):
        if np.abs(sections[m:] - sections[:-m]).max() < 1e-6 * np.abs(sections).max():
            points["x0"], points["v0"] = sections[-1]
            whole = integrate(points, transient=0, periods=m, at_section=True)
            return sections[-1], (m, round(m * whole["impacts_per_period"].item()))
    return sections[-1], None


def persists(oscillator, axis, values, state, expected):
    """Whether a motion keeps its class from value to value."""
    for value in values:
        there = Oscillator(**{**oscillator, axis: value})
        for transient in (2_000, 200_000):  # beside a bifurcation it settles slowly
            state, reached = settled(there, state, transient)
            if reached == expected:
                break
        else:
            return False
    return True


def free(h, omega, f, p=1.0, **others):
    """Return the state of the free motion at the phase 0."""
    amplitude = -f / (p * p - omega * omega + 2j * h * omega)
    return amplitude.imag, omega * amplitude.real


def missing(sweep, found, oscillator, axis):
    """Return how many classes the list names beside its values, and those not found there.

    They are looked for from motions of the sweep, from the bifurcation and from the free motion.
    """
    values, gap = sweep[axis].values, np.diff(sweep[axis].values).max()
    states = np.stack([sweep["poincare_x"].values, sweep["poincare_v"].values], axis=-1)[:, -1]
    shares = np.concatenate([np.linspace(1.0, 0.1, 40), np.geomspace(0.1, 1e-3, 15), [0.0]])
    named, absent = 0, []
    marks = np.append(values, found["value"].dropna())
    for row in found.dropna(subset="value").to_dict("records"):
        for side, way in (("before", -1), ("after", 1)):
            m, _, q = row[side].partition("/")
            if not q or int(m) > 32:
                continue
            named, expected = named + 1, (int(m), int(q))
            apart = way * (marks - row["value"])
            target = row["value"] + way * min(BESIDE * gap, *(apart[apart > 0.0] / 2.0))
            nearest = np.argsort(np.where(way * (values - target) > 0.0, abs(values - target), 9e9))
            starts = [(values[i], states[i]) for i in nearest[:4]]
            starts.append((target, (row["x"], row["v"])))
            starts.append((target, free(**oscillator | {axis: target})))
            if not any(
                persists(oscillator, axis, target + (value - target) * shares, state, expected)
                for value, state in starts
            ):
                absent.append((row["kind"], row["orbit"], row["value"], side, row[side]))
    return named, absent


def test_a_motion_that_has_ended_is_not_named(tmp_path):
    """Neither one that begins later, at the flip before."""
    _, found = run(tmp_path, "h", CASE)
    rows = found[found["value"].between(0.1037, 0.1101)]
    expected = "flip 12/12 24/24 ?", "fold 8/7 8/7 ?", "graze 4/4 ? 4/3"
    cells = rows[["kind", "orbit", "before", "after"]].values
    assert [" ".join(row) for row in cells] == [*expected]


@pytest.mark.parametrize(
    "seed", [34, *(pytest.param(n, marks=pytest.mark.campaign) for n in range(60, 160))]
)
def test_what_is_named_beside_a_bifurcation_exists_there(tmp_path, seed):
    random = np.random.default_rng(seed)
    axis = [*RANGES][seed % len(RANGES)]
    oscillator = {name: random.uniform(*ends) for name, ends in RANGES.items()}
    values = np.linspace(*RANGES[axis], int(random.integers(20, 140))).tolist()
    sweep, found = run(tmp_path, axis, oscillator | {axis: values})
    named, absent = missing(sweep, found, oscillator, axis)
    assert not absent and (named or seed != 34)

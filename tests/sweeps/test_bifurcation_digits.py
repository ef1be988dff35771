"""The digits that `info --bifurcations` prints, against Newton's method on the section map."""

from dataclasses import fields

import mpmath as mp
import pytest

from commands import accepted
from oscillators import SectionMap
from sweep_files import run_in
from sweeps import branches, open_sweep
from vibroimpact import Oscillator, PeriodicOrbit

#: Oscillators, and how many bifurcations of at most 4 periods and 5 impacts each has on its axis.
SCENES = {
    "light damping": ("h: 0.05, R: 0.8, f: 1, omega: {start: 2.6, stop: 2.72, num: 13}", 1),
    "no damping": ("h: 0, R: 0.8, f: 1, omega: {start: 2.6, stop: 2.74, num: 15}", 3),
    "impact adding": ("h: 0.5, omega: 1, f: 1, R: {start: 0.5, stop: 0.7, num: 21}", 4),
    "hysteresis": (
        "h: 0.05, R: 0.8, f: 1, clearance: 1.5, omega: {start: 1.2, stop: 1.7, num: 26}", 2
    ),
    "two periods": (
        "h: 0.02, R: 0.9, omega: 0.81, clearance: 1, f: {start: 0.343, stop: 0.37, num: 10}", 8
    ),
    "grazing": (
        "h: 0.1, R: 0.8, omega: 0.7, f: 1, clearance: {start: 1.87, stop: 1.93, num: 25}", 4
    ),
}  # fmt: skip
RECORD = "record: {transient: 400, periods: 32, diagnostics: [period]}"


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_all_twelve_digits_are_those_of_the_section_map(tmp_path, scene):
    oscillator, count = SCENES[scene]
    axis = oscillator.split(": {")[0].split()[-1]
    path = run_in(tmp_path, f"oscillator: {{{oscillator}}}\n{RECORD}")
    listed = accepted("info", path, "--bifurcations").split("exact branch")[-1].splitlines()[1:]
    printed = {
        (words[1], words[2], words[0]) for words in map(str.split, listed) if len(words) == 3
    }
    with open_sweep(path) as dataset:
        found = branches(dataset, axis)
        fixed = {field.name: dataset[field.name].values.flat[0] for field in fields(Oscillator)}
    compared = set()
    for i, kind in enumerate(found["kind"].values):
        m, q, value = (found[f"special_{name}"].values[i] for name in ("m", "q", "value"))
        if kind not in ("flip", "fold", "graze") or m > 4 or q > 5:
            continue
        oscillator = Oscillator(**{**fixed, axis: value})
        impacts = (found[f"special_impact_{name}"].values[i, :q] for name in ("phase", "v"))
        with mp.workdps(50):
            orbit = PeriodicOrbit(oscillator, int(m), *impacts)
            expected = float(SectionMap(orbit).bifurcation(kind, axis))
        compared.add((kind, f"{m}/{q}", f"{expected:.12g}"))
    assert compared <= printed
    assert len(compared) == count

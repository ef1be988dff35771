"""Tables of points beside a rig in SI units: columns of the model and of the rig."""

import math
from pathlib import Path

import h5py
import numpy as np
import pytest

from sweeps import open_sweep, plotting, run_sweep
from tests.helpers.commands import accepted
from tests.helpers.configurations import load
from tests.helpers.rigs import (
    DAMPING,
    GAP,
    JOINT,
    MASS,
    STIFFNESS,
    VALUES,
    R,
    columns_of,
    points_of,
    rig,
)
from vibroimpact import Oscillator


def test_the_columns_of_a_table_beside_a_rig_are_those_of_the_model():
    text = rig(frequency=None, force=None) + "points: {omega: [10, 20], f: [1, 2], serial: [a, b]}"
    config = load(text)
    osc = Oscillator.from_rig(**VALUES | {"frequency": 1.0, "force": 1.0})
    points = points_of(config)
    assert points["omega"].tolist() == [10.0, 20.0] and points["f"].tolist() == [1.0, 2.0]
    assert set(points["p"]) == {osc.p} and set(points["h"]) == {osc.h}
    assert points_of(load(config.to_yaml())).tobytes() == points.tobytes()


OF_RIG = {
    "stiffness": [800.0, 810.5, 795.3], "damping": [1.2, 1.1, 1.3], "gap": [5e-4, 5.1e-4, 4.9e-4],
    "force": [10.0, 11.0, 9.7], "frequency": [3.3, 3.1, 2.9], "R": [0.8, 0.7, 0.75],
    "base": [0.0, 1e-5, 2e-5],
}  # fmt: skip
FIXED = {"damping": 1.2, "force": 10.3, "base": 1e-5, "frequency": 3.3, "gap": 5e-4, "R": 0.8}


@pytest.mark.parametrize(
    ("fixed", "columns"),
    [
        ({"mass": 2.0}, OF_RIG),
        (FIXED, {"mass": [2.0, 2.1, 1.97], "stiffness": OF_RIG["stiffness"]}),
        ({**FIXED, "force": None, "mass": 2.0}, {"stiffness": [1.0, 2.0]}),
    ],
)
def test_the_columns_of_a_table_may_be_those_of_the_rig(fixed, columns):
    """The points equal those of `Oscillator.from_rig` row by row, from a mapping and from CSV."""
    fixed = {name: value for name, value in fixed.items() if value is not None}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    made = [Oscillator.from_rig(**fixed, **row) for row in rows]
    head, lines = ",".join(columns), [",".join(map(repr, row.values())) for row in rows]
    Path("table.csv").write_text("\n".join([f"{head},serial", *(f"{line},a" for line in lines)]))
    for points in ({**columns, "serial": ["a"] * len(rows)}, "table.csv"):
        config = load({"rig": fixed, "points": points})
        given = points_of(config)
        for name in ("h", "p", "f", "omega", "clearance", "a", "R"):
            assert given[name].tolist() == [getattr(osc, name) for osc in made], name
        assert points_of(load(config.to_yaml())).tobytes() == given.tobytes()
        assert f"stiffness: {columns['stiffness']}" in config.to_yaml()


@pytest.mark.parametrize(
    ("scene", "units"),
    [
        (
            "rig: {mass: 1, damping: 1, frequency: 2, R: 0.8, force: 1, gap: 0}\n",
            {"stiffness": "N/m"},
        ),
        ("oscillator: {h: 0.1, omega: 2, f: 1}\nunits: {length: mm, time: s}\n", {}),
    ],
    ids=["rig", "no rig"],
)
def test_only_columns_of_the_rig_have_units(scene, units, stop_after):
    """Further columns have none, also if they have the names of the base units."""
    columns = {"stiffness": [1.0, 2.0], "length": [4.0, 5.0], "time": [9.0, 8.0]}
    columns |= {} if units else {"mass": [3.0, 7.0], "R": [0.8, 0.7]}
    config = load(scene + f"points: {columns}\nrecord: {{transient: 10, periods: 4}}\n")
    expected = {name: units.get(name, "1") for name in columns}
    with stop_after(1, size=1), pytest.raises(KeyboardInterrupt):
        run_sweep(config, "table.h5")
    with open_sweep("table.h5") as part:
        assert {name: part[name].units for name in columns} == expected
    run_sweep(config, "table.h5", resume=True)
    with h5py.File("table.h5") as file:
        assert {name: file[name].attrs["units"] for name in columns} == expected
    with open_sweep("table.h5") as whole:
        assert {name: whole[name].units for name in columns} == expected
    lines = accepted("info", "table.h5").splitlines()
    assert "length = 4 .. 5, 2 values" in [line.removeprefix("column").strip() for line in lines]


@pytest.mark.slow
def test_typed_columns_of_a_rig_are_kept_with_their_units_and_run_again(unpainted):
    """2 * 0.5 * (c / (2 * 0.5)) and sqrt(k / m)^2 m do not give every number back."""
    stiffness, frequency = [8000.1, 7999.3, 8100.7], [35.3, 36.7, 15.0]
    table = f"points: {{stiffness: {stiffness}, frequency: {frequency}, serial: [7, 8, 9]}}\n"
    text = JOINT.replace(f"stiffness: {STIFFNESS}, ", "").replace(
        ", frequency: {start: 22, stop: 41, num: 39}", ""
    )
    path = run_sweep(load(text + table), "typed.h5")
    with open_sweep(path) as ds:
        assert ds["stiffness"].values.tolist() == stiffness and ds["stiffness"].units == "N/m"
        assert ds["p"].values.tolist() == [math.sqrt(k / MASS) for k in stiffness]
    accepted("export", path, "-o", "typed.csv")
    k, nu = columns_of("typed.csv", "stiffness", "frequency")
    assert (k.tolist(), nu.tolist()) == (stiffness, frequency)
    assert Path("typed.csv").read_text().splitlines()[0].count("stiffness") == 1
    accepted("run", path, "-o", "again.h5", "--quiet")
    with open_sweep(path) as one, open_sweep("again.h5") as other:
        assert one["poincare_x"].values.tobytes() == other["poincare_x"].values.tobytes()
        assert other["stiffness"].values.tolist() == stiffness
    assert "stiffness" in accepted("info", path) and "N/m" in accepted("info", path)
    planned = accepted("run", path, "-o", "dry.h5", "--dry-run")
    assert "stiffness = 7999.3 .. 8100.7 [N/m], 3 values" in planned
    accepted("plot", path, "--axis", "stiffness", "--quantity", "impulse", "-o", "typed.png")


@pytest.mark.slow
def test_results_are_those_of_the_mass_of_their_row(unpainted):
    """A mass twice as large at the same h, p and f of the model has twice the impulse."""
    table = (
        "points: {mass: [0.5, 1.0], stiffness: [8000, 16000], damping: [4, 8], force: [8, 16]}\n"
    )
    path = run_sweep(load(f"rig: {{gap: {GAP}, R: {R}, frequency: 36}}\n" + table), "mass.h5")
    accepted("export", path, "-o", "mass.csv")
    names = "mass", "stiffness", "force", "impulse", "energy_lost"
    mass, k, force, impulse, energy = columns_of("mass.csv", *names)
    assert (mass.tolist(), k.tolist()) == ([0.5, 1.0], [8000.0, 16000.0])
    assert force.tolist() == [8.0, 16.0]
    assert impulse[0] > 0.0 and impulse[1] == 2.0 * impulse[0] and energy[1] == 2.0 * energy[0]
    accepted("plot", path, "--axis", "mass", "--quantity", "impulse", "-o", "mass.png")
    accepted("run", path, "-o", "mass2.h5", "--quiet")
    with open_sweep(path) as one, open_sweep("mass2.h5") as other:
        assert one["poincare_x"].values.tobytes() == other["poincare_x"].values.tobytes()
        assert other["mass"].values.tolist() == [0.5, 1.0] and other["mass"].units == "kg"
        panel = plotting.table_panels(one, axes=["mass"], quantity="impulse").axes[0]
    assert panel.get_xlabel().endswith("[kg]")
    assert panel.get_title(loc="left").endswith("[N\N{NO-BREAK SPACE}s]")
    fixed = run_sweep(load(f"rig: {{stiffness: 8000, damping: 4, force: 8, gap: {GAP}, R: {R}, "
                           "frequency: 36}\npoints: {mass: [0.5, 0.6]}\n"), "fixed.h5")  # fmt: skip
    accepted("export", fixed, "-o", "fixed.csv")
    k, c, force = columns_of("fixed.csv", "stiffness", "damping", "force")
    assert (k.tolist(), c.tolist(), force.tolist()) == ([8000.0] * 2, [4.0] * 2, [8.0] * 2)
    assert "mass = 0.5 .. 0.6 [kg], 2 values" in accepted("info", fixed)


@pytest.mark.slow
def test_a_table_beside_a_rig_is_read_in_si_units():
    table = "points: {omega: [100, 200, 250], h: [4, 4, 3], serial: [7, 8, 9]}\n"
    text = JOINT.replace(f"damping: {DAMPING}, ", "").replace(
        ", frequency: {start: 22, stop: 41, num: 39}", ""
    )
    path = run_sweep(load(text + table), "table.h5")
    accepted("export", path, "-o", "table.csv")
    head = "point,mass,damping,R,frequency,force,stiffness,gap,base,x0,v0,phase,serial,"
    assert Path("table.csv").read_text().startswith(head + "impacts_per_period,")
    nu, c, serial, x0 = columns_of("table.csv", "frequency", "damping", "serial", "x0")
    assert nu.tolist() == [omega / (2.0 * math.pi) for omega in (100, 200, 250)]
    assert (c.tolist(), serial.tolist(), x0.tolist()) == ([4, 4, 3], [7, 8, 9], [0, 0, 0])
    with open_sweep(path) as ds:
        figure = plotting.table_panels(ds, quantity="impulse")
        assert ds["omega"].values.tolist() == [100, 200, 250]
    assert figure.axes[0].get_xlabel().endswith("[Hz]")
    assert figure.axes[0].get_title(loc="left").endswith("[N\N{NO-BREAK SPACE}s]")
    offsets = figure.axes[0].collections[0].get_offsets()
    assert np.asarray(offsets)[:, 0] == pytest.approx(nu)

"""Tables of points beside a rig in SI units: columns of the model and of the rig."""

import math
from pathlib import Path

import h5py
import pytest

from sweeps import open_sweep, plotting, run_sweep
from tests.helpers.commands import accepted
from tests.helpers.configurations import load
from tests.helpers.rigs import (
    DAMPING,
    FORCE,
    GAP,
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


#: A rig with a table of what is left out of it, and columns of the tables and pictures.
SHORT = f"rig: {{mass: {MASS}, R: {R}, gap: {GAP}"
CASES = {
    # 2 * 0.5 * (c / (2 * 0.5)) and sqrt(k / m)^2 m do not give every number back.
    "typed": (
        f"{SHORT}, damping: {DAMPING}, force: {FORCE}}}\n",
        {
            "stiffness": [8000.1, 7999.3, 8100.7],
            "frequency": [35.3, 36.7, 15.0],
            "serial": [7, 8, 9],
        },
        {},
    ),
    "model": (
        f"{SHORT}, stiffness: {STIFFNESS}, force: {FORCE}}}\n",
        {"omega": [100.0, 200.0, 250.0], "h": [4.0, 4.0, 3.0], "serial": [7, 8, 9]},
        {"frequency": [w / (2.0 * math.pi) for w in (100, 200, 250)], "damping": [4.0, 4.0, 3.0]},
    ),
    "mass": (
        f"rig: {{gap: {GAP}, R: {R}, frequency: 36}}\n",
        {"mass": [0.5, 1.0], "stiffness": [8e3, 16e3], "damping": [4.0, 8.0], "force": [8.0, 16.0]},
        {},
    ),
    "mass alone": (
        f"rig: {{gap: {GAP}, R: {R}, frequency: 36, stiffness: 8000, damping: 4, force: 8}}\n",
        {"mass": [0.5, 0.6]},
        {"stiffness": [8e3] * 2, "damping": [4.0] * 2, "force": [8.0] * 2},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_table_beside_a_rig_is_kept_with_its_units_and_run_again(case, unpainted):
    rig_alone, columns, others = CASES[case]
    path = run_sweep(load(f"{rig_alone}points: {columns}\n"), "table.h5")
    accepted("export", path, "-o", "table.csv")
    head = Path("table.csv").read_text().splitlines()[0].split(",")
    assert len(set(head)) == len(head) and not {"omega", "h", "f", "p", "clearance"} & {*head}
    for name, values in {**columns, **others}.items():
        if name not in ("omega", "h"):
            assert columns_of("table.csv", name)[0].tolist() == values
    accepted("run", path, "-o", "again.h5", "--quiet")
    with open_sweep(path) as one, open_sweep("again.h5") as other:
        assert one["poincare_x"].values.tobytes() == other["poincare_x"].values.tobytes()
        for name, values in columns.items():
            assert one[name].values.tolist() == other[name].values.tolist() == values
        figure = plotting.table_panels(one, quantity="impulse")
    assert figure.axes[0].get_title(loc="left").endswith("[N\N{NO-BREAK SPACE}s]")
    if case == "mass":  # twice as large at the same h, p and f of the model: twice the impulse
        assert figure.axes[0].get_xlabel().endswith("[kg]")
        impulse, energy = columns_of("table.csv", "impulse", "energy_lost")
        assert impulse[1] == 2.0 * impulse[0] > 0.0 and energy[1] == 2.0 * energy[0]
    if case == "typed":
        with open_sweep(path) as dataset:
            assert dataset["p"].values.tolist() == [
                math.sqrt(k / MASS) for k in columns["stiffness"]
            ]
        planned = accepted("run", path, "-o", "dry.h5", "--dry-run")
        assert "stiffness = 7999.3 .. 8100.7 [N/m], 3 values" in planned
        assert "stiffness = 7999.3 .. 8100.7 [N/m], 3 values" in accepted("info", path)
        accepted("plot", path, "--axis", "stiffness", "--quantity", "impulse", "-o", "typed.png")

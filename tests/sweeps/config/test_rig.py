"""A rig in SI units: the file has the model's numbers, also of a table; bad rigs are refused."""

import math
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from sweeps import open_sweep, plotting, run_sweep
from sweeps.config.values import Range
from sweeps.errors import ConfigError
from tests.helpers.commands import accepted
from tests.helpers.configurations import linear_values, load, refusal
from tests.helpers.rigs import (
    DAMPING,
    FORCE,
    FREQUENCY,
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
from vibroimpact.oscillator import PARAMETERS

SWEPT = ["stiffness", "damping", "force", "frequency", "gap", "base"]


@pytest.mark.parametrize("name", [*SWEPT, "R"])
@pytest.mark.parametrize(
    ("given", "values"),
    [
        ("[0.37, 0.11, 0.9]", [0.11, 0.37, 0.9]),
        ("{start: 0.1, stop: 0.7, num: 53}", linear_values(0.1, 0.7, 53)),
        (
            "{start: 0.1, stop: 0.7, num: 53, spacing: log}",
            Range(start=0.1, stop=0.7, num=53, spacing="log").values(),
        ),
    ],
)
def test_every_value_is_converted_as_from_rig_converts_it(name, given, values):
    numbers = {**VALUES, "frequency": 3.3}
    points = points_of(load(rig(**{"frequency": 3.3, name: given})))
    expected = [Oscillator.from_rig(**{**numbers, name: float(value)}).at()[0] for value in values]
    assert points.tolist() == [tuple(point) for point in expected]


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_every_value_of_a_rig_comes_back_from_the_model_to_the_last_bit(spacing):
    """By the formulas of the conversions alone, a third of the frequencies does not."""
    ranges = {name: f"{{start: 0.1, stop: 70, num: 997, spacing: {spacing}}}" for name in SWEPT}
    for name in SWEPT:
        config = load(rig(**{"frequency": 15, "stiffness": 50000, name: ranges[name]}))
        given = {key: getattr(config.rig, key) for key in SWEPT}
        expected = {key: np.atleast_1d(given[key]) for key in SWEPT if key != name}
        expected[name] = given[name].values()
        grid = config.sweep.grid
        values = config.nomenclature.selection({**grid.fixed, **grid.axes})
        for key in SWEPT:
            assert np.atleast_1d(values[key]).tolist() == expected[key].tolist()
    further = np.linspace(1.0, 2.0, 11)
    halved = config.nomenclature.selection({"omega": further, "impulse": further})
    assert halved["frequency"] == pytest.approx(further / (2.0 * math.pi), rel=1e-15)
    assert halved["impulse"] == pytest.approx(VALUES["mass"] * further, rel=1e-15)


def test_names_units_and_numbers_are_those_of_the_rig_or_of_the_model():
    """One object has both, and leads back from what a reader types."""
    model, of_rig = (load(text).nomenclature for text in (
        "oscillator: {h: 0.05, R: 0.8, omega: 2.5, f: 1.0}\nunits: {length: mm, time: s}\n", rig(),
    ))  # fmt: skip
    assert model.parameters == PARAMETERS and model.unit("length/time^2") == "mm/s^2"
    assert [*of_rig.parameters] == ["mass", *map(of_rig.name, PARAMETERS)]
    assert {of_rig.name(own) for own in PARAMETERS} == {*SWEPT, "R", "x0", "v0", "phase"}
    for seen in (model, of_rig):
        for own in PARAMETERS:
            name = seen.name(own)
            assert seen.parameter(name) == own and seen.parameters[name] == seen.about(own)
            assert seen.in_model(own, seen.value(own, 0.37)) == pytest.approx(0.37, rel=1e-15)
    assert of_rig.unit(of_rig.about("h").unit) == "N s/m" and of_rig.unit("length") == "m"
    assert of_rig.value("omega", math.tau * 50.0) == pytest.approx(50.0, rel=1e-15)


def test_axes_of_earlier_versions_come_back_as_typed():
    """Their ranges were those of `np.linspace`, an ulp or two beside the numbers typed."""
    config = load(rig(frequency="{start: 0.1, stop: 2, num: 20}"))
    old = 2.0 * math.pi * np.linspace(0.1, 2, 20)
    assert (old != config.sweep.grid.axes["omega"]).any()
    typed = linear_values(0.1, 2, 20)
    assert config.rig.in_si("omega", old).tolist() == typed.tolist()
    assert config.rig.in_si("omega", old[::-1]).tolist() == typed[::-1].tolist()


def test_the_axes_are_in_the_order_of_the_keys_and_come_back_from_the_yaml():
    config = load(rig(R="[0.7, 0.8]", frequency=None)[:-2] + f", frequency: {FREQUENCY}}}\n"
                  "start: {x0: [-0.001, 0.0]}\n")  # fmt: skip
    assert list(config.sweep.grid.axes) == ["R", "omega", "x0"]
    again = load(config.to_yaml())
    assert list(again.sweep.grid.axes) == ["R", "omega", "x0"]
    assert points_of(again).tobytes() == points_of(config).tobytes()
    assert again == load(again.to_yaml()) and again.to_yaml() == config.to_yaml()
    assert again.rig == config.rig and "oscillator" not in yaml.safe_load(config.to_yaml())
    assert dict(config.units) == {"length": "m", "time": "s", "mass": "kg"}


def test_one_number_of_a_range_of_a_rig_is_replaced():
    config = load(rig(), "rig.frequency.num=500", "rig.R=0.5")
    grid = config.sweep.grid
    assert grid.axes["omega"].tolist() == (2.0 * math.pi * linear_values(2, 12, 500)).tolist()
    assert grid.fixed["R"] == 0.5
    with pytest.raises(ConfigError, match=r"^override oscillator\.R=0\.5: .*: one of them, as rig"):
        load(rig(), "oscillator.R=0.5")
    with pytest.raises(
        ConfigError, match=r"^override rig\.R=0\.5: rig: conflicts with oscillator;"
    ):
        load("oscillator: {h: 0.1, R: 0.8, omega: 1, f: 1}\n", "rig.R=0.5")


@pytest.mark.parametrize(
    ("text", "line", "parts"),
    [
        (rig() + "oscillator: {h: 1}\n", 2, ["oscillator: conflicts with rig; expected: one"]),
        (rig(mass="-2"), 1, ["rig.mass = -2 is not allowed; expected: mass [kg]: ", "> 0"]),
        (rig(mass="{start: 1, stop: 2, num: 3}"), 1, ["rig.mass = {start: 1", "not a number",
                                                      "the same all over the sweep"]),
        (rig(force=None, base="0.0"), 1, ["rig.force is missing; expected: ", "unless base is"]),
        (rig(base="1e-200", frequency="1e254"), 1, ["rig.base: the force f + a omega^2 must be"]),
        (rig(frequnecy=3, frequency=None), 1, ["rig.frequnecy (did you mean frequency?)"]),
        (rig(damping="[1, -2]"), 1, ["rig.damping = [1, -2] contains -2, which is not allowed"]),
        (rig(frequency="{start: 0, stop: 1, num: 3}"), 1, ["rig.frequency = ", "contains 0"]),
        (rig(force="[1, 1e308]", mass="1e-9"), 1, ["contains 1e+308, which is not a finite number",
                                                   "in the units of the model; expected: ampl"]),
        (rig(stiffness="1e-300", mass="1e200"), 1, ["rig.stiffness = 1e-300 is not allowed"]),
        (rig(stiffness=f"[801, {math.nextafter(801.0, 900.0)!r}]"), 1, ["has the value", "twice"]),
        (rig(frequency="{start: 1, stop: 1e308, num: 2}"), 1,
         ["rig.frequency: is not a range in the units of the model: 6.283185307179586 to inf"]),
        (rig() + "start: {x0: 1}\n", 2, ["x0 = 1 lies beyond the stop at gap = ", "every gap"]),
        (rig() + "units: {length: mm}\n", 2, ["units.length: mm is not the unit of a rig", ": m"]),
        (rig() + "follow: {axis: force}\n", 2, ["follow.axis: force has only one value",
                                                "swept axis out of frequency"]),
        (rig() + "points: {omega: [1, 2]}\n", 1, ["rig.frequency: conflicts with points",
                                                  "a column omega of points"]),
        (rig(damping=None, frequency=3) + "points: {h: [1, 2], gap: [1, 2]}\n", 1,
         ["rig.gap: conflicts with points", "only a column gap of points"]),
        (rig(damping=None) + "points: {h: [1, 2], damping: [1, 2]}\n", 2,
         ["points.h: is damping in the units of the model; expected: one of both columns"]),
        (rig(frequency=3) + "points: {mass: [1, 2]}\n", 1,
         ["rig.mass: conflicts with points", "only a column mass of points"]),
        (rig(mass=None, frequency=3) + "points: {mass: [1, 0]}\n", 2,
         ["points: row 2, column mass = 0 is not allowed; expected: a finite number > 0"]),
        (rig(mass=None, frequency=3) + "points: {mass: [1, 1e-320]}\n", 2,
         ["points.mass: row 2, 9.99989e-321 makes h = inf; expected: a finite number >= 0"]),
        (rig(stiffness=None, frequency=3) + "points: {stifness: [1, 2], R: [0.5, 0.6]}\n", 2,
         ["points: unknown column stifness (did you mean stiffness?)", "or another word"]),
        (rig(stiffness=None, frequency=3) + "points: {stiffness: [800, 5e-324]}\n", 2,
         ["points.stiffness: row 2, 4.94066e-324 makes p = 0; expected: a finite number > 0"]),
        (rig(frequency=None) + "points: {frequency: [1, 1e308]}\n", 2,
         ["points.frequency: row 2, 1e+308 makes omega = inf; expected: a finite number > 0"]),
        ("mass: 3\n" + rig(), 1, ["unknown key mass (did you mean rig.mass?)"]),
        ("oscillator: {h: 0, R: 1, omega: 2, f: 1}\nunits: {mass: kg}\n", 2,
         ["units.mass: without a rig there is no mass"]),
    ],
)  # fmt: skip
def test_refused_rigs(text, line, parts):
    message = refusal(text)
    assert message.count("\n") == 0 and f"sweep.yaml, line {line}: " in message
    for part in parts:
        assert part in message


# Tables of points beside a rig: columns of the model and of the rig


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

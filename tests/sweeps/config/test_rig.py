"""A rig in SI units: the file has the model's numbers, and its user reads SI units."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from sweeps import (
    bifurcations,
    branches,
    integrity,
    knocks,
    open_sweep,
    plotting,
    run_sweep,
)
from sweeps.cli.main import app
from sweeps.config.json_schema import json_schema
from sweeps.config.values import Range
from sweeps.explorer.view import View
from sweeps.opened.dataset import in_si
from sweeps.store.writer import SweepWriter
from tests.helpers.commands import accepted, call, refused
from tests.helpers.configurations import linear_values, load, refusal
from tests.helpers.rigs import (
    DAMPING,
    FORCE,
    FREQUENCY,
    GAP,
    JOINT,
    MASS,
    STIFFNESS,
    VALUES,
    R,
    columns_of,
    points_of,
    rig,
    rows_of,
)
from tests.helpers.sweep_files import run_in
from vibroimpact import Oscillator
from vibroimpact.oscillator import PARAMETERS

SWEPT = ["stiffness", "damping", "force", "frequency", "gap", "base"]
# The numbers of the model


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


# Refused configurations


@pytest.mark.parametrize(
    ("text", "line", "parts"),
    [
        (rig() + "oscillator: {h: 1}\n", 1, ["rig: conflicts with oscillator; expected: one of"]),
        (rig(mass="-2"), 1, ["rig.mass = -2 is not allowed; expected: mass [kg]: ", "> 0"]),
        (rig(mass="{start: 1, stop: 2, num: 3}"), 1, ["rig.mass = {start: 1", "not a number",
                                                      "the same all over the sweep"]),
        (rig(mass="[1, 2]"), 1, ["rig.mass = [1, 2] is not a number"]),
        (rig(mass=None), 1, ["rig.mass is missing; expected: mass [kg]"]),
        (rig(stiffness=None), 1, ["rig.stiffness is missing; expected: ", "[N/m]"]),
        (rig(gap=None), 1, ["rig.gap is missing"]),
        (rig(force=None, base=None), 1, ["rig.force is missing; expected: ", "unless base is"]),
        (rig(force=None, base="0.0"), 1, ["rig.force is missing; expected: ", "unless base is"]),
        (rig(base="1e-200", frequency="1e254"), 1, ["rig.base: the force f + a omega^2 must be"]),
        (rig(frequnecy=3, frequency=None), 1, ["rig.frequnecy (did you mean frequency?)"]),
        (rig(k=3, stiffness=None), 1, ["unknown key rig.k (did you mean stiffness?)"]),
        (rig(omega=3, frequency=None), 1, ["unknown key rig.omega (did you mean frequency?)"]),
        (rig(damping="[1, -2]"), 1, ["rig.damping = [1, -2] contains -2, which is not allowed"]),
        (rig(R="1.2"), 1, ["rig.R = 1.2 is not allowed"]),
        (rig(frequency="{start: 0, stop: 1, num: 3}"), 1, ["rig.frequency = ", "contains 0"]),
        (rig(frequency="{start: 2, stop: 1, num: x}"), 1, ["rig.frequency.num = x is not an int"]),
        (rig(force="1e308", mass="1e-9"), 1, ["rig.force = 1e308 is not a finite number"]),
        (rig(force="[1, 1e308]", mass="1e-9"), 1, ["contains 1e+308, which is not a finite number",
                                                   "in the units of the model; expected: ampl"]),
        (rig(stiffness="1e-300", mass="1e200"), 1, ["rig.stiffness = 1e-300 is not allowed"]),
        (rig(stiffness=f"[801, {math.nextafter(801.0, 900.0)!r}]"), 1, ["has the value", "twice"]),
        (rig(frequency="{start: 1, stop: 1e308, num: 2}"), 1,
         ["rig.frequency: is not a range in the units of the model: 6.283185307179586 to inf"]),
        (rig() + "start: {x0: 1}\n", 2, ["x0 = 1 lies beyond the stop at gap = ", "every gap"]),
        (rig(gap="-0.1"), 1, ["rig.gap: x0 = 0 lies beyond the stop"]),
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
        (rig(stiffness=None, frequency=3) + "points: {stiffness: [800, 900, -1]}\n", 2,
         ["points: row 3, column stiffness = -1 is not allowed; expected: a finite number > 0"]),
        (rig(stiffness=None, frequency=3) + "points: {stiffness: [800, 5e-324]}\n", 2,
         ["points.stiffness: row 2, 4.94066e-324 makes p = 0; expected: a finite number > 0"]),
        (rig(frequency=None) + "points: {frequency: [1, 1e308]}\n", 2,
         ["points.frequency: row 2, 1e+308 makes omega = inf; expected: a finite number > 0"]),
        (rig(frequency=None) + "points: {frequency: [1, '2,5']}\n", 2,
         ["row 2, column frequency = 2,5 is not allowed", "with a decimal point"]),
        ("rig: 5\n", 1, ["rig = 5 is not allowed; expected: a rig in SI units"]),
        ("rig: null\n", 1, ["oscillator is missing"]),
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


def test_the_schema_has_the_rig_in_place_of_the_oscillator():
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    for text in (rig(), rig() + "follow: {axis: frequency}\n", rig(force=None), rig(base=None),
                 rig(frequency=None) + "points: {omega: [1, 2]}\n"):  # fmt: skip
        assert validator.is_valid(yaml.safe_load(text)), text
    for text in (rig(mass=None), rig(gap=None), rig(force=None, base=None), rig(q=1),
                 rig(force=None, base="0"), rig(mass="[1, 2]"), rig(damping="-1"),
                 rig() + "follow: {axis: base}\n",
                 rig() + "oscillator: {h: 1, R: 1, omega: 1, f: 1}\n"):  # fmt: skip
        assert not validator.is_valid(yaml.safe_load(text)), text


# What its user reads. The rig of the scene joint-clearance; the force meets a free amplitude of
# F / |k - m w^2 + i c w|, which is the gap at a graze


def stiffness_at(frequency):
    """Return k - m w^2 + i c w."""
    omega = 2.0 * math.pi * np.asarray(frequency)
    return STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega


def graze():
    """Return the frequency [Hz] above resonance at which the free amplitude is the gap."""
    b = 2.0 * STIFFNESS * MASS - DAMPING**2
    c = STIFFNESS**2 - (FORCE / GAP) ** 2
    return math.sqrt((b + math.sqrt(b * b - 4.0 * MASS**2 * c)) / (2.0 * MASS**2)) / (2.0 * math.pi)


@pytest.fixture(scope="module")
def joint_run(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("joint"), JOINT, name="joint.h5")


@pytest.fixture
def joint(folder, joint_run):
    return Path(shutil.copy(joint_run, "joint.h5"))


def test_the_file_has_the_names_and_numbers_of_the_model(joint):
    with open_sweep(joint) as ds:
        osc = Oscillator.from_rig(mass=MASS, stiffness=STIFFNESS, damping=DAMPING, force=FORCE,
                                  frequency=22.0, gap=GAP, R=R)  # fmt: skip
        assert ds["status"].dims == ("omega",) and float(ds["omega"][0]) == osc.omega
        assert float(ds["p"]) == osc.p and float(ds["clearance"]) == GAP
        assert (ds["omega"].units, ds["impulse"].units) == ("rad/s", "m/s")


def test_a_sweep_in_si_units_has_the_axes_of_the_rig_and_is_still_read_late(joint):
    with open_sweep(joint) as ds:
        si = in_si(ds)
        late = "poincare_x", "impulse", "energy_lost"
        assert not any(si.variables[name]._in_memory for name in late)
        assert si["status"].dims == ("frequency",)
        assert si["frequency"].values.tolist() == linear_values(22, 41, 39).tolist()
        assert si["omega"].dims == ("frequency",)  # beside it
        assert si["omega"].values.tobytes() == ds["omega"].values.tobytes()
        assert [float(si[name]) for name in ("mass", "gap", "p")] == [MASS, GAP, float(ds["p"])]
        assert si["impulse"].values.tolist() == (MASS * ds["impulse"].values).tolist()
        units = {"frequency": "Hz", "impulse": "N s", "energy_lost": "J", "poincare_v": "m/s"}
        assert {name: si[name].units for name in units} == units
        assert in_si(si) is si


@pytest.mark.slow
def test_what_is_computed_from_a_sweep_in_si_units_is_in_si_units(joint):
    turn = 2.0 * math.pi
    with open_sweep(joint) as ds:
        si = in_si(ds)
        own, changes = branches(ds), bifurcations(ds)
        found, listed = branches(si), bifurcations(si)
    assert list(found.coords) == ["frequency"]
    for name in ("multipliers", "poincare_x", "branch", "kind"):
        assert found[name].values.tobytes() == own[name].values.tobytes()
    assert turn * found["frequency"].values == pytest.approx(own["omega"].values, rel=1e-14)
    assert found.attrs["range"] == [22.0, 41.0]
    assert (listed.attrs["axis"], len(listed)) == ("frequency", len(changes))
    assert listed["kind"].tolist() == changes["kind"].tolist() and "fold" in set(changes["kind"])
    for name in ("value", "low", "high"):
        expected = changes[name].to_numpy()
        assert turn * listed[name].to_numpy() == pytest.approx(expected, rel=1e-14, nan_ok=True)


@pytest.mark.slow
def test_numbers_computed_in_python_are_drawn_over_the_axes_of_the_rig(joint):
    with open_sweep(joint) as ds:
        force = (ds["impulse"] * ds["omega"]).assign_attrs(long_name="my own", units="1")
        figure = plotting.bifurcation(ds, axes=["omega"], below=[force, ds["impulse"]])
        coloured = plotting.section(ds, color="omega")
        expected = [force.values, MASS * ds["impulse"].values]
    for panel, values in zip(figure.axes[1:], expected, strict=True):
        x, y = panel.lines[0].get_data()
        assert x.tolist() == linear_values(22, 41, 39).tolist() and y.tolist() == values.tolist()
    assert coloured.axes[1].get_xlabel() == r"forcing frequency $\nu$ [Hz]"


def test_the_mean_force_on_the_stop_of_a_rig_is_in_newtons(joint):
    with open_sweep(joint) as ds:
        (_, panel) = plotting.bifurcation(ds, below=["mean_force"]).axes
        at_rest = ds["rest_fraction"].values > 0.0
        speeds, impacts = ds["fastest_impact"].values, ds["impacts_per_period"].values
    assert panel.get_title(loc="left") == r"mean force on the stop $\overline{F}$ [N]"
    x, y = panel.lines[0].get_data()
    once = (impacts == 1.0) & ~at_rest
    assert once.sum() > 6
    assert y[once] == pytest.approx(MASS * (1.0 + R) * speeds[once] * x[once], rel=1e-6)


def test_a_diagram_of_a_rig_is_in_hertz(joint):
    with open_sweep(joint) as ds:
        figure = plotting.bifurcation(ds, below=["impulse"])
        speed, impacts = ds["fastest_impact"].values, ds["impacts_per_period"].values
    panel, below = figure.axes
    assert below.get_xlabel() == r"forcing frequency $\nu$ [Hz]"
    assert below.get_title(loc="left").endswith("per forcing period $J$ [N\N{NO-BREAK SPACE}s]")
    x, y = panel.lines[0].get_data()
    frequencies = linear_values(22, 41, 39)
    assert np.unique(x).tolist() == frequencies.tolist()
    free = x > 38.0  # beyond the fold the force alone moves the mass
    expected = -FORCE * np.imag(np.exp(1.5j) / stiffness_at(x[free]))
    assert free.sum() > 6 and y[free] == pytest.approx(expected, rel=1e-9)
    hits = impacts == 1.0
    assert hits.sum() > 5
    drawn = below.lines[0].get_ydata()[hits]
    assert drawn == pytest.approx(MASS * (1.0 + R) * speed[hits], rel=1e-9)
    title = figure.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")
    rig = "$m=0.5$ kg, $c=4$ N s/m, $R=0.7$, $F=8$ N, $k=8000$ N/m, $\\sigma=0.5$ mm,"
    assert rig in title
    assert "omega" not in title


@pytest.mark.slow
def test_lengths_in_pictures_have_the_prefix_of_their_size(joint, with_layout):
    with open_sweep(joint) as ds:
        section = plotting.section(ds, at={"omega": 190.0})
        motion = plotting.trajectory(ds, at={"omega": 190.0}, periods=2)
        wide = plotting.section(ds, at={"omega": 190.0}, page=plotting.Page(xlim=(-3.0, 3.0)))
        omega = float(ds["omega"].sel(omega=190.0, method="nearest"))
    for figure in (section, motion, wide):
        figure.draw_without_rendering()
    panel, over_time = section.axes[0], motion.axes[0]
    assert panel.get_xlabel() == "displacement at the section $x$ [mm]"
    ticks = [(text.get_text(), text.get_position()[0]) for text in panel.get_xticklabels()]
    written = [float(text.replace("\N{MINUS SIGN}", "-")) for text, _ in ticks]
    assert written == pytest.approx([1e3 * place for _, place in ticks], abs=1e-12)
    assert wide.axes[0].get_xlabel() == "displacement at the section $x$ [m]"
    assert over_time.get_ylabel() == "displacement $x$ [mm]"
    for figure in (section, motion):
        (legend,) = figure.legends
        assert "stop, $x=\\sigma=0.5$\N{NO-BREAK SPACE}mm" in [t.get_text() for t in legend.texts]
    t_0 = (508 * 2.0 * math.pi + 1.5) / omega  # the section is at phase 1.5
    assert f"$t_0={t_0:.6g}$\N{NO-BREAK SPACE}s, after" in motion.get_suptitle()


@pytest.mark.slow
def test_a_logarithmic_axis_of_gaps_has_the_prefix_too(with_layout):
    gaps = "rig.gap={start: 2e-5, stop: 4e-4, num: 9, spacing: log}"
    with open_sweep(run_sweep(load(JOINT, gaps, "rig.frequency=30"), "gaps.h5")) as ds:
        figure = plotting.bifurcation(ds, below=["impulse"])
    figure.draw_without_rendering()
    above, below = figure.axes
    assert (above.get_xlabel(), below.get_xlabel()) == ("", r"gap $\sigma$ [mm]")
    assert "0.05" in [text.get_text() for text in below.get_xticklabels()]


def test_a_file_of_a_rig_is_described_in_si_units(joint):
    text = accepted("info", joint).partition("rig:\n")[0]
    words = " ".join(text.split())
    for part in (
        "axis frequency = 22 .. 41 [Hz], 39 values",
        "rig mass = 0.5 [kg]", "rig stiffness = 8000 [N/m]", "rig damping = 4 [N s/m]",
        "rig force = 8 [N]", "rig gap = 0.0005 [m]", "rig R = 0.7 ",
        "impulse on the stop per forcing period [N s]",
    ):  # fmt: skip
        assert part in words
    assert "rad/s" not in text and "omega" not in text


def test_tables_of_a_rig_are_in_si_units(joint):
    accepted("export", joint, "-o", "out.csv")
    head = Path("out.csv").read_text().splitlines()[0]
    assert head.startswith("frequency,mass,damping,R,force,stiffness,gap,base,x0,v0,")
    nu, m, c, k, force, impulse, energy, speed, impacts = columns_of(
        "out.csv", "frequency", "mass", "damping", "stiffness", "force", "impulse",
        "energy_lost", "fastest_impact", "impacts_per_period",
    )  # fmt: skip
    assert nu.tolist() == linear_values(22, 41, 39).tolist()
    assert [set(one) for one in (m, c, k, force)] == [{MASS}, {DAMPING}, {STIFFNESS}, {FORCE}]
    hits = impacts == 1.0
    assert impulse[hits] == pytest.approx(MASS * (1.0 + R) * speed[hits], rel=1e-9)
    lost = 0.5 * MASS * (1.0 - R**2) * speed[hits] ** 2
    assert energy[hits] == pytest.approx(lost, rel=1e-9)


@pytest.mark.slow
def test_bifurcations_of_a_rig_are_in_hertz(joint, unpainted):
    text = accepted("info", joint, "--bifurcations", "--csv", "found.csv")
    listed = [line for line in text.splitlines() if " graze  1/1 " in line]
    assert float(listed[0].split()[0]) == pytest.approx(graze(), rel=1e-10)
    assert text.startswith("frequency [Hz]  kind")
    assert "omega" not in text
    low, high = columns_of("found.csv", "low", "high")
    assert ((low >= 22.0) & (high <= 41.0 * (1.0 + 1e-15))).all()
    said = accepted("plot", joint, "--exact", "--csv", "branches.csv")
    assert "omega" not in said
    grazes = [row for row in rows_of("branches.csv") if row["kind"] == "graze"]
    assert float(grazes[0]["frequency"]) == pytest.approx(graze(), rel=1e-12)


@pytest.mark.slow
def test_cuts_and_limits_are_those_of_the_axes(joint, unpainted):
    result = call("plot", joint, "--kind", "section", "--at", "frequency=23.4")
    assert "frequency = 23.4 is not on the grid; drawn at frequency = 23.5" in result.stderr
    accepted("plot", joint, "--axis", "frequency", "--xlim", "30:36")
    error = refused("plot", joint, "--xlim", "100:200")
    assert "the data range from 22 to 41" in error
    error = refused("plot", joint, "--kind", "section", "--at", "omega=150")
    assert "omega cannot be fixed here; choose from: frequency" in error
    error = refused("plot", joint, "--axis", "omega")
    assert "omega is not a swept axis (it is called frequency here); the file has freq" in error
    error = refused("plot", joint, "--axis", "frequency", "--axis", "frequency")
    assert "not frequency, frequency" in error
    error = refused("plot", joint, "--color", "nothing")
    assert error.rstrip().endswith("status, frequency, mean_force")
    error = refused("plot", joint, "--kind", "section", "--at", "frequency=50")
    assert "frequency = 50 is outside the sweep: 22 to 41" in error


@pytest.mark.slow
def test_a_rig_is_zoomed_in_hertz(joint, unpainted):
    accepted("zoom", joint, "frequency=34:36")
    with open_sweep("joint-frequency-34-36.h5") as ds:
        expected = 2.0 * math.pi * linear_values(34, 36, 39)
        assert ds["omega"].values.tolist() == expected.tolist()


@pytest.mark.slow
def test_a_run_of_a_rig_is_planned_in_hertz_and_resumed(monkeypatch):
    Path("joint.yaml").write_text(JOINT)
    assert "frequency = 22 .. 41 [Hz], 39 values" in accepted("run", "joint.yaml", "--dry-run")
    whole = run_sweep(load(JOINT), "whole.h5")
    with monkeypatch.context() as patch:
        patch.setattr(SweepWriter, "write", lambda *_: 1 / 0)
        assert isinstance(
            CliRunner().invoke(app, ["run", "joint.yaml"]).exception, ZeroDivisionError
        )
    assert not Path("joint.h5").exists() and Path("joint.h5.parts").exists()
    accepted("run", "joint.yaml", "--resume")
    with open_sweep(whole) as ds, open_sweep("joint.h5") as part:
        assert ds["poincare_x"].values.tobytes() == part["poincare_x"].values.tobytes()


@pytest.mark.slow
def test_a_map_of_a_rig_and_its_curves_are_in_si_units(unpainted):
    stiffness = "rig.stiffness={start: 7000, stop: 9000, num: 9}"
    config = load(JOINT, stiffness, "rig.frequency.num=12")
    path = run_sweep(config, "map.h5")
    with open_sweep(path) as ds:
        figure = plotting.parameter_map(ds)
        heat = plotting.parameter_map(ds, quantity="energy_lost")
    panel = figure.axes[0]
    assert panel.get_xlabel() == r"forcing frequency $\nu$ [Hz]"
    assert panel.get_ylabel() == "stiffness of the spring $k$ [N/m]"
    assert panel.get_ylim() == pytest.approx((6875.0, 9125.0), rel=1e-12)
    assert heat.axes[1].get_xlabel().endswith("[J]")
    accepted("plot", path, "--kind", "map", "--exact", "--csv", "curves.csv")
    kinds = [row["kind"] for row in rows_of("curves.csv")]
    nu, k = columns_of("curves.csv", "frequency", "stiffness")
    grazes = np.array(kinds) == "graze"
    assert grazes.any()
    omega = 2.0 * math.pi * nu[grazes]
    free = FORCE / np.abs(k[grazes] - MASS * omega**2 + 1j * DAMPING * omega)
    assert free == pytest.approx(GAP, rel=1e-6)


@pytest.mark.slow
def test_attractors_of_a_rig_are_listed_over_its_frequency():
    config = load(JOINT + "start: {x0: [-0.0005, 0.0, 0.0004], v0: [0.0, 0.1]}\n",
                  "record.phase=0", "rig.frequency.num=5")  # fmt: skip
    path = run_sweep(config, "starts.h5")
    text = accepted("attractors", path, "--csv", "attractors.csv")
    assert "frequency" in text and "omega" not in text and "22 .. 3" in text
    (nu,) = columns_of("attractors.csv", "frequency")
    assert np.unique(nu) == pytest.approx([22.0, 26.75, 31.5, 36.25, 41.0])
    with open_sweep(path) as ds:
        panel = plotting.attractor_diagram(ds).axes[0]
        (legend,) = plotting.basins(ds).legends
    assert "speed before each impact [m/s]; share" in legend.get_title().get_text()
    assert panel.get_xlabel().endswith("[Hz]")
    assert panel.dataLim.intervalx == pytest.approx([22.0, 41.0])
    assert "shown at frequency = 31.5" in call("attractors", path, "--at", "frequency=30").stderr


@pytest.mark.slow
def test_attractors_and_their_measures_have_units():
    """At 36 Hz the motions 1/1 and 1/0 coexist."""
    x0, v0 = "{start: -0.0015, stop: 0.0005, num: 6}", "{start: -0.4, stop: 0.4, num: 6}"
    few = "record={transient: 200, periods: 8}", "rig.frequency=[36, 37]"
    path = run_sweep(load(JOINT, f"start={{x0: {x0}, v0: {v0}}}", *few), "measured.h5")
    heads = {
        ("attractors",): ["class  frequency [Hz]  parameter points"],
        ("attractors", "--at", "frequency=36"): ["class  speeds before the impacts [m/s]  share"],
        ("integrity",): ["frequency [Hz]  attractor", "integrity factor [m]  local integrity [m]"],
        ("integrity", "--at", "frequency=36"): ["local integrity [m]  least knock [m/s]"],
    }
    for (command, *options), parts in heads.items():
        text = accepted(command, path, *options)
        assert all(part in text.splitlines()[0] for part in parts)
        assert command == "attractors" or "p = sqrt(stiffness / mass), at" in text
    with open_sweep(path) as ds:
        found = knocks(ds.isel(omega=0), integrity(ds.isel(omega=0)))
        figure = plotting.integrity(ds)
    units = {"section_x": "m", "section_v": "m/s", "disc_v": "m/s", "local_integrity": "m"}
    units |= {"knock_harmful": "m/s", "knock_phase": "rad", "fraction": "1"}
    assert {name: found[name].units for name in units} == units
    figure.draw_without_rendering()
    labels = ["", "[mm]", "[mm]", "initial velocity $v_0$ [m/s]"]
    assert [panel.get_ylabel().strip() for panel in figure.axes] == labels


def test_the_live_picture_of_a_rig_is_in_hz_and_computed_with_the_numbers_of_the_model():
    view = View.of(load(JOINT))
    assert view.axis == "omega" and view.xlim == (22.0, 41.0)
    omega = view.diagram(5).sweep.grid.axes["omega"]
    assert (omega[0], omega[-1]) == (2 * math.pi * 22, 2 * math.pi * 41)
    assert view.diagram(5).sweep.grid.fixed["p"] == math.sqrt(STIFFNESS / MASS)

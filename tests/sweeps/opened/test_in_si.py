"""What the user of a rig reads: axes, tables, pictures and reports in SI units."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from sweeps import (
    Refused,
    bifurcations,
    branches,
    integrity,
    knocks,
    open_sweep,
    plotting,
    run_sweep,
)
from sweeps.opened.doors import in_si
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import accepted, call, refused
from tests.helpers.configurations import linear_values, load
from tests.helpers.rigs import DAMPING, FORCE, GAP, JOINT, MASS, STIFFNESS, R, columns_of, rows_of

pytestmark = pytest.mark.slow

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


FILES = {"joint": JOINT}


@pytest.fixture
def joint(folder, files):
    return Path(shutil.copy(files / "joint.h5", folder))


def test_a_sweep_in_si_units_has_the_axes_of_the_rig_and_is_still_read_late(joint):
    with open_sweep(joint) as ds:
        si = in_si(OpenedSweep(ds))
        late = "poincare_x", "impulse", "energy_lost"
        assert not any(si.data.variables[name]._in_memory for name in late)
        assert si["status"].dims == ("frequency",)
        assert si["frequency"].values.tolist() == linear_values(22, 41, 39).tolist()
        assert si["omega"].dims == ("frequency",)  # beside it
        assert si["omega"].values.tobytes() == ds["omega"].values.tobytes()
        assert [float(si[name]) for name in ("mass", "gap", "p")] == [MASS, GAP, float(ds["p"])]
        assert si["impulse"].values.tolist() == (MASS * ds["impulse"].values).tolist()
        units = {"frequency": "Hz", "impulse": "N s", "energy_lost": "J", "poincare_v": "m/s"}
        assert {name: si[name].units for name in units} == units
        assert in_si(si) is si


def test_what_is_computed_from_a_sweep_in_si_units_is_in_si_units(joint):
    turn = 2.0 * math.pi
    with open_sweep(joint) as ds:
        si = in_si(OpenedSweep(ds))
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


def test_numbers_computed_in_python_are_drawn_over_the_axes_of_the_rig(joint):
    with open_sweep(joint) as ds:
        force = (ds["impulse"] * ds["omega"]).assign_attrs(long_name="my own", units="1")
        figure = plotting.bifurcation(ds, axes=["omega"], below=[force, ds["impulse"]])
        coloured = plotting.section(ds, color="omega")
        expected = [force.values, MASS * ds["impulse"].values]
        with pytest.raises(Refused, match="omega, frequency: two of these are one axis"):
            plotting.section(ds, at={"omega": 150.0, "frequency": 30.0})
    for panel, values in zip(figure.axes[1:], expected, strict=True):
        x, y = panel.lines[0].get_data()
        assert x.tolist() == linear_values(22, 41, 39).tolist() and y.tolist() == values.tolist()
    assert coloured.axes[1].get_xlabel() == r"forcing frequency $\nu$ [Hz]"


def test_a_diagram_of_a_rig_is_in_hertz_and_the_mean_force_on_the_stop_in_newtons(joint):
    with open_sweep(joint) as ds:
        figure = plotting.bifurcation(ds, below=["impulse", "mean_force"])
        speed, impacts = ds["fastest_impact"].values, ds["impacts_per_period"].values
        at_rest = ds["rest_fraction"].values > 0.0
    panel, below, force = figure.axes
    assert force.get_xlabel() == r"forcing frequency $\nu$ [Hz]"
    assert force.get_title(loc="left") == r"mean force on the stop $\overline{F}$ [N]"
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
    (x, y), once = force.lines[0].get_data(), hits & ~at_rest
    assert once.sum() > 6
    assert y[once] == pytest.approx(MASS * (1.0 + R) * speed[once] * x[once], rel=1e-6)
    title = figure.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")
    rig = "$m=0.5$ kg, $c=4$ N s/m, $R=0.7$, $F=8$ N, $k=8000$ N/m, $\\sigma=0.5$ mm,"
    assert rig in title
    assert "omega" not in title


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


def test_a_logarithmic_axis_of_gaps_has_the_prefix_too(with_layout):
    gaps = "rig.gap={start: 2e-5, stop: 4e-4, num: 9, spacing: log}"
    figure = plotting.bifurcation(
        run_sweep(load(JOINT, gaps, "rig.frequency=30"), "gaps.h5"), below=["impulse"]
    )
    figure.draw_without_rendering()
    above, below = figure.axes
    assert (above.get_xlabel(), below.get_xlabel()) == ("", r"gap $\sigma$ [mm]")
    assert "0.05" in [text.get_text() for text in below.get_xticklabels()]


def test_a_file_of_a_rig_is_described_in_si_units(joint):
    plan = accepted("run", joint, "--dry-run", "--overwrite")
    assert "frequency = 22 .. 41 [Hz], 39 values" in plan
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


def test_cuts_and_limits_are_those_of_the_axes(joint, unpainted):
    result = call("plot", joint, "--kind", "section", "--at", "frequency=23.4")
    assert "frequency = 23.4 is not on the grid; drawn at frequency = 23.5" in result.stderr
    accepted("plot", joint, "--xlim", "30:36Hz", "--xlabel", "on [Hz]", "--ylabel", "to [m]")
    for words, said in (
        ("--xlim 100:200", "the data range from 22 to 41"),
        ("--xlim 30:36kHz", "in kHz is not allowed; expected: Hz"),
        ("--xlabel speed[rpm]", "xlabel in rpm is not allowed; expected: Hz"),
        ("--ylabel speed[ft/s]", "ylabel in ft/s is not allowed; expected: m or mm"),
        ("--kind section --at omega=150", "omega cannot be fixed here; choose from: frequency"),
        ("--axis omega", "omega is not a swept axis (it is called frequency here); the file has f"),
        ("--axis frequency --axis frequency", "not frequency, frequency"),
        ("--color nothing", "status, frequency, mean_force\n"),
        ("--kind section --at frequency=50", "frequency = 50 is outside the sweep: 22 to 41"),
    ):
        assert said in refused("plot", joint, *words.split())


def test_a_rig_is_zoomed_in_hertz(joint, unpainted):
    accepted("zoom", joint, "frequency=34:36")
    with open_sweep("joint-frequency-34-36.h5") as ds:
        expected = 2.0 * math.pi * linear_values(34, 36, 39)
        assert ds["omega"].values.tolist() == expected.tolist()


def test_a_map_of_a_rig_and_its_curves_are_in_si_units(unpainted):
    stiffness = "rig.stiffness={start: 7000, stop: 9000, num: 9}"
    config = load(JOINT, stiffness, "rig.frequency.num=12")
    path = run_sweep(config, "map.h5")
    figure = plotting.parameter_map(path)
    heat = plotting.parameter_map(path, quantity="energy_lost")
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


def test_attractors_and_their_measures_have_units(no_knocks):
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
        assert plotting.attractor_diagram(ds).axes[0].get_xlabel().endswith("[Hz]")
    units = {"section_x": "m", "section_v": "m/s", "disc_v": "m/s", "local_integrity": "m"}
    units |= {"knock_harmful": "m/s", "knock_phase": "rad", "fraction": "1"}
    assert {name: found[name].units for name in units} == units
    figure.draw_without_rendering()
    labels = ["", "[mm]", "[mm]", "initial velocity $v_0$ [m/s]"]
    assert [panel.get_ylabel().strip() for panel in figure.axes] == labels

"""The tables and the pictures of attractors; their measures and knocks in other units."""

import csv

import numpy as np
import pytest

from sweeps import attractors, integrity, knocks, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_report, attractor_rows, starts_at
from sweeps.attractor.tracking import MOST_TRACKED
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import attractor_diagram, basins, plot
from tests.helpers.commands import accepted, call
from tests.helpers.equal_points import legend_texts
from tests.helpers.motions import cycle, given_sections, partition
from tests.helpers.other_units import in_units
from vibroimpact.status import Status


@pytest.mark.slow
def test_the_table_and_its_file(computed_starts, tmp_path):
    dataset = computed_starts()
    file = dataset.encoding["source"]
    lines = accepted("attractors", file, "--csv", tmp_path / "a.csv").splitlines()
    assert lines[1].split()[:5] == ["0", "2/3", "0.703,", "1.114,", "2.254"]
    assert lines[2].split()[:3] == ["1", "1/1", "1.423"]
    with (tmp_path / "a.csv").open() as text:
        table = list(csv.DictReader(text))
    assert [row["m"] + row["q"] for row in table] == ["23", "11"]
    assert sum(float(row["fraction"]) for row in table) == pytest.approx(1.0)
    assert float(table[1]["impact_v"]) == pytest.approx(1.4225, abs=1e-4)
    units = {one.attrs.get("units") for one in integrity(dataset).variables.values()}
    assert units == {"1", "rad", None}  # no length/time, which other programs refuse


@pytest.mark.slow
def test_the_table_over_a_parameter(computed_starts):
    dataset = computed_starts(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.69, num: 143}, f: 1.0}",
        "start={x0: [-1.6, -0.8, 0.0], v0: [-1.0, 0.0, 1.0]}",
    )
    file = dataset.encoding["source"]
    result = call("attractors", file)
    assert "0          1/1, 2/2" in result.stdout and "9 starts at each" in result.stdout
    result = call("attractors", file, "--at", "omega=1.3001")
    assert "2/3" in result.stdout and "1/1" in result.stdout
    assert "shown at omega = 1.3" in result.stderr
    here = starts_at(OpenedSweep(dataset), {"omega": 1.3})
    assert len(attractor_rows(here, attractors(here))) == 2


@pytest.mark.parametrize("count", [MOST_TRACKED, MOST_TRACKED + 1])
def test_the_table_says_where_attractors_are_too_many_to_be_tracked(count):
    states = [[cycle((-1.0 - 0.01 * i, 0.0)) for i in range(count)]] * 2
    dataset = given_sections(states, 1, axes=("h", "x0"))
    found = attractors(dataset)
    sweep = OpenedSweep(dataset)
    text = attractor_report(sweep, found, attractor_rows(sweep, found))
    note = "at 2 parameter points more than 50 attractors are periodic: none of these has"
    assert (note in text) == (count > 50) and f"{count} attractors at 2 of 2" in text
    assert found["number"].values.max() + 1 == (count if count == 50 else 2 * count)


def test_a_refusal_offers_only_what_can_be_fixed():
    """Of a grid the parameters and the phase of the starts, not the starts; of a table nothing."""
    at_starts = np.zeros((2, 3, 4, 16, 2))
    grid = given_sections(at_starts, 1, axes=("omega", "phase", "v0"))
    assert starts_at(OpenedSweep(grid), {"omega": 0.1, "phase": 0.2})["status"].dims == ("v0",)
    for name, why in (("v0", ": all its values are used"), ("direction", ""), ("h", "")):
        with pytest.raises(Refused, match=f"{name} cannot be fixed here{why}; choose from: omega"):
            starts_at(OpenedSweep(grid), {name: 1.0})
    table = given_sections(np.zeros((4, 16, 2)), 1, axes=("point",))
    for name in ("point", "omega"):
        with pytest.raises(Refused, match=f"{name} cannot be fixed here.*; there is no axis to"):
            starts_at(OpenedSweep(table), {name: 1.0})


def test_the_colours_of_the_basins_are_the_attractors(computed_starts):
    dataset = computed_starts()
    figure = basins(dataset)
    (mesh,) = figure.axes[0].collections
    drawn = mesh.get_array()
    own = attractors(dataset)["attractor"].transpose("v0", "x0").values
    assert partition(drawn) == partition(own)
    share = 100.0 * attractors(dataset)["fraction"].values
    first, second = f"2/3: 0.703, 1.114, 2.254; {share[0]:.1f} %", f"1/1: 1.423; {share[1]:.1f} %"
    assert legend_texts(figure) == [first, second, "attractors at the section"]


@pytest.mark.slow
def test_basins_of_a_file_that_is_not_complete(computed_starts):
    dataset = computed_starts().load().copy(deep=True)
    dataset["status"][0, 0], dataset["status"][1, 1] = Status.PENDING, Status.UNRESOLVED
    labels = legend_texts(basins(dataset))
    assert "unresolved" in labels and "not computed yet (1 of 81)" in labels
    plot(dataset, "a.svg")


@pytest.mark.parametrize(
    ("draw", "options", "text"),
    [
        (basins, {"at": {"R": 0.5}}, "R cannot be fixed here"),
        (attractor_diagram, {}, "only x0, v0 were swept; the picture of both is basins"),
        (attractor_diagram, {"coordinate": "pie"}, "over a swept parameter"),
    ],
)
def test_pictures_that_do_not_fit_are_refused(computed_starts, draw, options, text):
    with pytest.raises(Refused, match=text):
        draw(computed_starts(), **options)


def test_up_and_down_are_starts():
    """Two branches along h, one of them reached both ways at the ends only."""
    points = np.empty((6, 2, 16, 2))
    points[:, 0], points[:, 1] = cycle((-1.0, 0.0), turns=16), cycle((-0.2, 0.0), turns=16)
    points[0, 1], points[5, 0] = points[0, 0], points[5, 1]
    dataset = given_sections(points, 1, axes=("h", "direction")).assign_coords(
        direction=["up", "down"]
    )
    found = attractors(dataset)
    assert found["attractors"].dims == ("h",)
    assert found["attractors"].values.tolist() == [1, 2, 2, 2, 2, 1]
    assert len(attractor_rows(OpenedSweep(dataset), found)) == 10


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

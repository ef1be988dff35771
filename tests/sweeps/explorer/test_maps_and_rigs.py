"""The maps of the page, and the page of a rig in its names and SI units, without a browser."""

import re
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document

from sweeps import ConfigError, load_config, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.attractor.attractors import attractors
from sweeps.explorer.figures import without_tex
from sweeps.explorer.live_maps import Filling
from sweeps.explorer.live_motion import motion_at
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.view import BASINS_TAB, MAP_TAB, View, write_yaml
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import style
from sweeps.plotting.looks import Looks, basin_cells, period_cells
from tests.helpers.places import CONFIGS
from vibroimpact.oscillator import PARAMETERS, Oscillator


@pytest.mark.slow
@pytest.mark.parametrize("tab", [MAP_TAB, BASINS_TAB])
def test_a_map_is_filled_from_coarse_to_fine_to_what_is_computed_at_once(view, tab, tmp_path):
    view = replace(view, record={**view.record, "transient": 100, "periods": 30})
    view = view.moved(h=0.0, omega=1.3) if tab == BASINS_TAB else view
    config, (x, y) = view.tiles(tab, 50, 30), (name for name, _ in view.plane(tab))
    filling = Filling(config, x, tab == BASINS_TAB)
    shares = [np.mean(filling.advance(stop).pixels > 0) for stop in filling.stops]
    assert filling.stops[0] == 4 and shares[0] > 0.9  # two cells by two, each of 27 pixels
    tiles = filling.advance(config.sweep.grid.size)
    whole = open_sweep(run_sweep(config, tmp_path / "whole.h5")).transpose(y, x, ...)
    if tab == MAP_TAB:
        cells = period_cells(*OpenedSweep(whole).classes, hatched=False)
        cells = [cell for cell in cells if cell.where.any()]
    else:
        result = attractors(whole, extensions=0)
        found = result["attractor"].values
        sweep = OpenedSweep(whole)
        cells = basin_cells(attractor_rows(sweep, result), found, Looks.of(result), sweep)
    assert len(cells) == len(tiles.kinds) > 1
    for number, (cell, kind) in enumerate(zip(cells, tiles.kinds, strict=True), 1):
        label, *seen = kind
        assert label.partition("; disc")[0] == without_tex(cell.label)
        assert seen == [cell.look.colour, pytest.approx(cell.where.mean())]
        np.testing.assert_array_equal(tiles.pixels == number, cell.where)


@pytest.mark.slow
def test_a_map_has_the_name_of_its_class_in_every_region_with_room(view):
    """A name stands on points of its class, and the two largest classes have one."""
    view = replace(view, record={**view.record, "transient": 100, "periods": 20})
    config = view.tiles(MAP_TAB, 240, 180)
    filling = Filling(config, view.axis, basins=False)
    third = [stop for stop in filling.stops if stop <= 240 * 180 / 9]
    assert filling.advance(third[-2]).names == []
    at_third, complete = (filling.advance(stop).names for stop in (third[-1], 240 * 180))
    assert at_third == complete != []
    m, q = (filling._raster(filling._classes[name]) for name in ("m", "q"))
    shares = {}
    for name, column, row, _ in complete:
        if not name.startswith("rest"):
            assert name == f"{m[row, column]}/{q[row, column]}"
            shares[name] = np.mean((m == m[row, column]) & (q == q[row, column]))
    assert {"1/1", "2/2"} <= set(shares)
    assert sum(shares.values()) > 0.4


def test_the_shares_of_a_part_of_a_map_are_those_of_the_whole(view):
    """A class that fills the left or the lower half has half of the points at every stop."""
    config = view.tiles(MAP_TAB, 160, 120)
    filling = Filling(config, view.axis, basins=False)
    places = np.unravel_index(filling._order, config.sweep.grid.shape)
    for place, size in zip(places, config.sweep.grid.shape, strict=True):
        shares = [np.mean(place[:stop] < size // 2) for stop in filling.stops if stop > 400]
        assert len(shares) > 10 and np.ptp([*shares, 0.5]) < 0.03


def test_more_basins_than_colours_share_one():
    """Without force and losses, every start is an attractor. A pixel has 256 values."""
    x0, v0 = {"start": -5.0, "stop": 4.0, "num": 20}, {"start": 0.1, "stop": 5.0, "num": 15}
    free = {"h": 0, "R": 1, "omega": 1, "f": 0, "clearance": 10}
    record, start = {"transient": 0, "periods": 4}, {"x0": x0, "v0": v0}
    config = load_config({"oscillator": free, "start": start, "record": record})
    tiles = Filling(config, "x0", basins=True).advance(300)
    *six, (label, _, share) = tiles.kinds
    assert len(six) == len(tiles.discs) == 6 and all("disc" in label for label, *_ in six)
    assert [colour for _, colour, _ in six] == [style.CLASSES[1, 0], *style.FURTHER]
    assert len({label.partition("at x=")[2] for label, *_ in six}) == 6
    assert label == "294 other periodic attractors: 98.0 %" and share == pytest.approx(0.98)
    assert np.bincount(tiles.pixels.ravel()).tolist() == [0, 1, 1, 1, 1, 1, 1, 294]


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """The page of a rig on a shaker, swept from 15 to 32 Hz; one test changes its view."""
    view = View.of(load_config(CONFIGS / "shaker.yaml"))
    page = LivePage(Document(), view, tmp_path_factory.mktemp("rig"))
    yield page
    page.worker.shutdown()


@pytest.mark.slow
def test_a_rig_has_its_names_and_si_units(rig):
    """k = 8,000 N/m; the spring carries 0.5 kg at 20.1 Hz, and p is 126 per second."""
    view, figure = rig.view, rig.diagram.figure
    assert (view.values["p"], view.xlim) == (8000.0, (15.0, 32.0))
    rig._resized(rig.diagram, "inner_width", 0, 600)
    assert figure.xaxis.axis_label == "forcing frequency ν [Hz]"
    assert rig.controls.fields["p"].value == "8000"
    rig.controls.fields["p"].value = "-1"
    expected = "stiffness = -1 is not allowed; expected: a finite number > 0"
    assert rig.controls.error.text == expected
    rig.controls.sliders["p"].value = 9000.0
    assert "stiffness=9000.0&" in rig.view.query() and "frequency" in rig.view.query()
    assert view.with_query(rig.view.query()).checked() == rig.view
    with pytest.raises(ConfigError, match="expected: one of damping, R, frequency"):
        view.with_query("axis=mass").checked()
    assert view.with_axis("p").xlim == pytest.approx((0.5**2 * 8000.0, 2.0**2 * 8000.0))


@pytest.mark.slow
def test_a_picture_of_a_rig_is_drawn_in_si_units_from_the_numbers_of_its_run(rig, tmp_path):
    view = replace(rig.home, record={**rig.home.record, "transient": 20, "periods": 10})
    config = view.diagram(18)
    rig.diagram._paint(rig.diagram._draw(view, config, 20), 0.0)
    data = rig.diagram.source.data
    assert (data["x"], data["dw"]) == ([14.5], [18.0])
    plane = replace(view, across="p", maplim=(6e3, 9e3))
    rig.map._paint(plane, Filling(plane.tiles(MAP_TAB, 18, 4), "omega", False).advance(72), 0.0)
    data = rig.map.source.data
    assert (data["y"], data["dh"]) == ([5500.0], [4000.0])
    saved = write_yaml(view, config, tmp_path).read_text()
    assert "stiffness: 8000.0" in saved and "--xlim=15.0:32.0" in saved
    typed = {"mass": 0.5, "stiffness": 8e3, "damping": 4, "gap": 3e-4, "R": 0.7, "base": 5e-5}
    by_hand = [Oscillator.from_rig(**typed, frequency=float(nu)) for nu in range(15, 33)]
    axis = config.sweep.grid.axes["omega"]
    np.testing.assert_array_equal(axis, [osc.omega for osc in by_hand])
    assert {osc.p for osc in by_hand} == {config.sweep.grid.fixed["p"]}


@pytest.mark.slow
def test_exact_branches_of_a_rig_are_at_their_frequencies(rig):
    """The free oscillation grazes where its amplitude in closed form is the gap."""
    p2, h, a, gap = 8000.0 / 0.5, 4.0 / (2 * 0.5), 5e-5, 3e-4
    # a^2 w^4 = gap^2 ((p^2 - w^2)^2 + 4 h^2 w^2), a quadratic in w^2
    squares = np.roots([gap**2 - a**2, gap**2 * (4 * h**2 - 2 * p2), gap**2 * p2**2])
    parts = rig.branches._find(rig.home, rig.home.diagram(40))
    for graze in np.sqrt(squares) / (2 * np.pi):
        assert min(abs(np.array(parts["graze"]["x"]) - graze)) < 1e-6 * graze
    assert max(x.max() for x in parts[style.STABLE]["x"]) == pytest.approx(32.0)


@pytest.mark.slow
def test_the_fields_of_a_rig_have_the_units_of_their_numbers(rig, view, page_of):
    titles, plain = ([page.controls.fields[name].title for name in PARAMETERS]
                     for page in (rig, page_of(view)))  # fmt: skip
    of_oscillator = ["c [N s/m]", "R", "ν [Hz]", "F [N]", "k [N/m]", "σ [m]", "a [m]"]
    assert titles == [*of_oscillator, "x₀ [m]", "v₀ [m/s]", "ω t₀"]
    assert plain[:3] == ["h", "R", "ω"]


@pytest.mark.slow
def test_the_radius_of_a_disc_has_the_unit_of_the_starts():
    text = {"mass": 0.5, "stiffness": 8e3, "damping": 4, "force": 8, "gap": 5e-4, "R": 0.7}
    x0, v0 = {"start": -1.5e-3, "stop": 5e-4, "num": 20}, {"start": -0.4, "stop": 0.4, "num": 15}
    rig = {"rig": {**text, "frequency": 36}, "start": {"x0": x0, "v0": v0}}
    config = load_config({**rig, "record": {"transient": 300, "periods": 8, "phase": 0}})
    tiles = Filling(config, "x0", basins=True).advance(300)
    assert tiles.discs
    for (label, *_), (*_, width, _) in zip(tiles.kinds, tiles.discs, strict=False):
        (number,) = re.findall(r"disc (?:>= )?([\d.]+) mm$", label)
        assert float(number) == pytest.approx(0.5e3 * width, rel=5e-3)


@pytest.mark.slow
def test_the_text_on_a_motion_of_a_rig_has_units(rig):
    rig.motion._paint(rig.home, motion_at(rig.home), 0.0)
    assert "ν = 15 Hz: settled on 1/0; " in rig.motion.text.text
    assert rig.motion.text.text.endswith("stop, x = σ = 0.3 mm")

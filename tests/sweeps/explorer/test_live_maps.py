"""The maps of the page without a browser: how they are filled, their names, shares and basins."""

from dataclasses import replace

import numpy as np
import pytest

from sweeps import load_config, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.attractor.attractors import attractors
from sweeps.explorer.figures import without_tex
from sweeps.explorer.live_maps import Filling
from sweeps.explorer.view import BASINS_TAB, MAP_TAB
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import style
from sweeps.plotting.looks import Looks, basin_cells, period_cells


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

"""Fills each `Map` in `Tiles`: classes over two parameters, and basins with discs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from html import escape
from time import perf_counter

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Div, Range1d, Span

from sweeps.attractor.attractor_table import AttractorRow, orbits_of
from sweeps.attractor.attractors import COUNTED, attractors_of
from sweeps.attractor.integrity import measures_of
from sweeps.config.sweep import SweepConfig
from sweeps.engine.estimate import block_size
from sweeps.engine.executors import compute
from sweeps.explorer.figures import PixelFigure, Report, Step, narrow, outer_edges, without_tex
from sweeps.explorer.view import BASINS_TAB, View
from sweeps.opened.motions import MOTION, motions_from
from sweeps.plotting.labels import as_variable, with_unit
from sweeps.plotting.looks import (
    Looks,
    basin_cells,
    class_numbers,
    class_of_numbers,
    failed_cells,
    period_cells,
)
from vibroimpact.points.regimes import Regime
from vibroimpact.status import Status

#: Distances between the columns (and rows) computed in each pass, from coarse to fine. Each is an
#: odd multiple of the next, so that the middle of a cell is also the middle of a smaller cell.
_STRIDES = (27, 9, 3, 1)
#: A map is shown at least this many times until it is complete.
_PICTURES = 20
#: Names are placed on every so many columns and rows, as soon as these are computed.
_NAMED = 3
#: Height of a name and width of one of its characters, with the space around it [px].
_LINE, _CHARACTER = 18.0, 8.0
#: A name of a region: its text, the column and row of its middle, and whether it is upright.
Name = tuple[str, int, int, bool]
#: The columns of a disc: x and v of its centre, and its size along each.
_DISC = ("x", "y", "width", "height")
Disc = tuple[float, float, float, float]
#: The fields of a motion that are kept of every point.
_CLASS = ("regime", "m", "q")


@dataclass(frozen=True)
class Tiles:
    """A map, complete or partly computed."""

    config: SweepConfig
    kinds: list[tuple[str, str, float]]  # label, colour, share of the computed points
    #: 1 + the index of the kind; a point not computed yet has the value of a point beside it;
    #: uint8, shape (rows, columns).
    pixels: np.ndarray
    names: list[Name]
    discs: list[Disc]  # the largest disc in each basin, once the map is complete
    points: int  # number of computed points
    seconds: float  # time to compute their results


class Filling:
    """A map with the axis `x` on the abscissa, while its points are computed, coarse to fine."""

    def __init__(self, config: SweepConfig, x: str, basins: bool) -> None:
        self.config, self._x = config, x
        #: Whether the points are starts, which are assigned to the basins of their attractors.
        self._basins = basins
        levels = np.maximum.outer(*map(_levels, config.sweep.grid.shape)).ravel()
        #: The numbers of the points in the order of their computation.
        # Each level in random order, so that the shares shown meanwhile are those of the whole map.
        shuffled = np.random.default_rng(0).permutation(levels.size)
        self._order = np.lexsort((shuffled, levels))
        every = -(-levels.size // _PICTURES)
        #: Numbers of computed points at which the map is shown.
        self.stops = sorted({*np.cumsum(np.bincount(levels)), *range(every, levels.size, every)})
        self._done, self._seconds = 0, 0.0
        self._status = np.full(levels.size, Status.PENDING)
        self._classes = {name: np.zeros(levels.size, MOTION[name]) for name in _CLASS}
        #: A motion on each attractor found, and the attractor of each start.
        self._attractor_motions = np.empty(0, MOTION)
        self._attractors = np.full(levels.size, -1)

    def advance(self, stop: int) -> Tiles:
        """Continue until `stop` points are computed, also after an earlier call was cancelled."""
        sweep = self.config.sweep
        while self._done < stop:
            size = block_size(sweep, least=stop - self._done)
            at = self._order[self._done : min(self._done + size, stop)]
            begin = perf_counter()
            points = sweep.grid.numbered(at)
            results = compute(sweep.spec, points, None)
            self._seconds += perf_counter() - begin
            motions = motions_from(sweep.spec, points, results)
            self._status[at] = results["status"]
            for name, values in self._classes.items():
                values[at] = motions[name]
            if self._basins:
                self._group(at, motions)
            self._done += at.size
        return self._tiles()

    def _group(self, at: np.ndarray, motions: np.ndarray) -> None:
        """Assign the motions of starts to the attractors found before, or to new ones."""
        both = np.concatenate([self._attractor_motions, motions])
        of_each, attractors = attractors_of(both, np.zeros(both.size, int), self.config.sweep.spec)
        before, now = np.split(attractors, [-at.size])
        self._attractors = np.append(before, -1)[self._attractors]
        self._attractors[at] = now
        self._attractor_motions = both[of_each]

    def _tiles(self) -> Tiles:
        """Colour the computed points by the kinds that `plot` uses."""
        discs = list[Disc]()
        if self._basins:
            table, classes = self._ranked()
            names = class_of_numbers(table)
            looks = Looks.of_rows(table)
            cells = basin_cells(table, classes, looks, self.config.nomenclature)
            for i, row in enumerate(looks.split(table)[0]):
                if self._done == self._order.size and row.regime in COUNTED:
                    disc, radius = self._disc(cells[i].where)
                    discs.append(disc)
                    cells[i] = cells[i]._replace(name=f"{cells[i].name}; {radius}")
        else:
            cells = period_cells(*self._classes.values(), hatched=False)
            classes, names = class_numbers(*self._classes.values())
        pixels, kinds = np.zeros(self._order.size, np.uint8), []
        for cell in (*cells, *failed_cells(self._status)):
            if count := np.count_nonzero(cell.where):
                kinds.append((without_tex(cell.label), cell.look.colour, float(count) / self._done))
                pixels[cell.where.ravel()] = len(kinds)
        region_names = self._region_names(classes, names)
        return Tiles(
            self.config, kinds, _filled(self._raster(pixels)), region_names, discs, self._done,
            self._seconds,
        )  # fmt: skip

    def _raster(self, values: np.ndarray) -> np.ndarray:
        """Return the values of the points, shape (rows, columns)."""
        grid = self.config.sweep.grid
        values = values.reshape(grid.shape)
        return values.T if next(iter(grid.axes)) == self._x else values

    def _region_names(self, classes: np.ndarray, names: dict[int, str]) -> list[Name]:
        """Return the names of the regions of a map; none until enough of it is computed."""
        from sweeps.plotting.placed_names import placed_names

        grid = self._raster(classes)
        rows, columns = (_middles_of_cells(size, _NAMED) for size in grid.shape)
        computed = self._raster(self._status != Status.PENDING)[np.ix_(rows, columns)]
        if not computed.all():
            return []

        def box(name: str) -> tuple[int, int]:
            """Return the height and the width of a name in the columns and rows of its place."""
            return math.ceil(_LINE / _NAMED), math.ceil(_CHARACTER * len(name) / _NAMED)

        return [
            (name, int(columns[column]), int(rows[row]), upright)
            for name, row, column, upright in placed_names(grid[np.ix_(rows, columns)], names, box)
        ]

    def _disc(self, basin: np.ndarray) -> tuple[Disc, str]:
        """Return the largest disc in a basin, and its radius for the name of cells."""
        grid, basin = self.config.sweep.grid, self._raster(basin).T
        x, v, p, stop = grid.axes["x0"], grid.axes["v0"], grid.fixed["p"], grid.fixed["clearance"]
        corner = np.array([[x[0], v[0]]])
        radius, *centre, at_edge, _, _ = measures_of(basin, x, v, 1.0 / p, stop, corner)
        disc = centre[0], centre[1], 2.0 * radius, 2.0 * radius * p
        number, unit = with_unit(as_variable("x0", self.config.nomenclature), radius)
        text = f"disc {'>= ' if at_edge else ''}{number:.3g} {unit}".rstrip()
        return disc, text.replace("%", "%%")

    def _ranked(self) -> tuple[list[AttractorRow], np.ndarray]:
        """Return the attractors by decreasing share, renumbered, and the number of each start."""
        motions = self._attractor_motions
        counts = np.bincount(self._attractors + 1, minlength=len(motions) + 1)[1:]
        order = np.argsort(-counts, kind="stable")
        aperiodic = motions["regime"] != Regime.PERIODIC
        number = np.empty(len(order), int)
        number[order[np.argsort(aperiodic[order], kind="stable")]] = np.arange(len(order))
        shares = (counts / counts.sum()).tolist()
        m, q, regime = (motions[name] for name in ("m", "q", "regime"))
        orbits = orbits_of(self.config.sweep.spec, motions["point"], np.where(aperiodic, 0, m), q)
        table = [
            AttractorRow(
                {}, int(number[i]), Regime(regime[i]), int(m[i]), int(q[i]), shares[i], *orbits[i]
            )
            for i in order.tolist()
        ]
        return table, np.append(number, -1)[self._attractors]


def _middles_of_cells(size: int, stride: int) -> np.ndarray:
    """Return the middle of every cell of `stride` columns."""
    return np.minimum(np.arange(stride // 2, size + stride // 2, stride), size - 1)


def _levels(size: int) -> np.ndarray:
    """Return, for each of `size` columns, the index of the first stride that computes it."""
    levels = np.empty(size, int)
    for level in reversed(range(len(_STRIDES))):
        levels[_middles_of_cells(size, _STRIDES[level])] = level
    return levels


def _filled(pixels: np.ndarray) -> np.ndarray:
    """Fill pixels that are 0 from the middle of the smallest cell around them with a value."""
    filled = np.zeros_like(pixels)
    for stride in _STRIDES:
        at = (_middles_of_cells(size, stride)[np.arange(size) // stride] for size in pixels.shape)
        finer = pixels[np.ix_(*at)]
        filled = np.where(finer, finer, filled)
    return filled


class Map(PixelFigure):
    """The figure of a tab over two parameters: ``MAP_TAB`` or ``BASINS_TAB``."""

    def __init__(self, name: str, tab: int, report: Report, x_range: Range1d | None = None) -> None:
        super().__init__(name, report, x_range)
        self._name, self._tab = name, tab
        #: The points of the last view, partly or completely computed.
        self.filling: Filling | None = None
        self.figure.grid.visible = False
        self._lines = [Span(dimension=side, line_color="white") for side in ("height", "width")]
        for line in self._lines:
            self.figure.add_layout(line)
        self.discs = ColumnDataSource({column: [] for column in _DISC}, name=f"{name} discs")
        self.figure.ellipse(*_DISC, source=self.discs, fill_alpha=0.0, line_color="black")
        self.names = ColumnDataSource(
            {column: [] for column in ("x", "y", "text", "angle")}, name=f"{name} names"
        )
        self.figure.text(
            source=self.names, text_align="center", text_baseline="middle", text_font_size="12px",
            background_fill_color="white", background_fill_alpha=0.7, padding=1, angle="angle",
        )  # fmt: skip
        self.legend = Div(name=f"{name} legend", text="", sizing_mode="stretch_width")
        # Its height is fixed: a different height of the figure would need other points.
        self.legend.update(margin=(0, 8, 4, 60), height=36, styles={"overflow-y": "auto"})
        wider = narrow(flex="none", height="min(108px, 15vh)", margin_left="8px")
        self.legend.stylesheets = [wider]
        self.layout = column(self.figure, self.legend, sizing_mode="stretch_both")

    def resize(self, side: str, pixels: int) -> None:
        """Set the size if it is greater; with fewer pixels the finer picture is kept."""
        super().resize(side, max(pixels, self.size[side == "inner_height"]))

    def show(self, view: View) -> None:
        """Set the axes and the mark."""
        for side, line, (name, window) in zip(
            "xy", self._lines, view.plane(self._tab), strict=True
        ):
            self.set_axis(side, name, view, window)
            line.update(location=view.values[name], visible=view.marked)

    def steps(self, view: View) -> list[Step]:
        """Return the steps that draw a view from coarse to fine."""
        config = self.saved(view)
        if self.filling is None or self.filling.config != config:
            self.filling = Filling(config, view.plane(self._tab)[0][0], self._tab == BASINS_TAB)
        advance, show = self.filling.advance, partial(self._paint, view)
        stops = self.filling.stops
        return [Step(self._name, (config, n), partial(advance, n), show) for n in stops]

    def saved(self, view: View) -> SweepConfig:
        """Return the configuration to save: the complete map, with a point for every pixel."""
        return view.tiles(self._tab, *self.resolution)

    def _paint(self, view: View, tiles: Tiles, seconds: float) -> None:
        """Show a map and its legend; one that is not complete waits for no slow connection."""
        if tiles.points < tiles.config.sweep.size and not self.is_painted:
            return
        axes, nomenclature = tiles.config.sweep.grid.axes, tiles.config.nomenclature
        sides = [(name, nomenclature.value(name, axes[name])) for name, _ in view.plane(self._tab)]
        x, y = (outer_edges(values, name in view.log) for name, values in sides)
        self.names.data = {
            "x": [sides[0][1][column] for _, column, _, _ in tiles.names],
            "y": [sides[1][1][row] for _, _, row, _ in tiles.names],
            "text": [name for name, *_ in tiles.names],
            "angle": [0.5 * math.pi * upright for *_, upright in tiles.names],
        }
        self.set_colours([colour for _, colour, _ in tiles.kinds])
        self.set_pixels(tiles.pixels, x, y)
        discs = np.reshape(tiles.discs, (-1, len(_DISC))).T.tolist()
        self.discs.data = dict(zip(_DISC, discs, strict=True))
        self.legend.text = " &nbsp; ".join(
            f"<span style='display:inline-block'><span style='color:{colour}'>■</span> "
            f"{escape(label)}{'' if '%' in label else f' ({100.0 * share:.3g} %)'}</span>"
            for label, colour, share in tiles.kinds
        )
        self._report(tiles.config, tiles.points, tiles.seconds, seconds)

"""Places names in regions of a map where there is room; draws the boundaries of regions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Ellipse
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation, Text

from sweeps.plotting import canvas
from sweeps.plotting.pixels import figure_of, in_panel
from sweeps.plotting.style import ground, ink

#: Pixels per inch at which the room for a name is measured, and its least share of a name's box,
#: because single cells of another class hide nothing.
_PER_INCH, _LEAST_SHARE = 72.0, 0.97
#: Space around a name, and half the size of a marker [px].
_MARGIN, _HALF_MARKER = 1, 2
#: Most names in a panel.
_MOST_IN_PANEL = 60
#: Least share of a map on both sides of a boundary that is drawn.
_LARGE = 4e-4


def name_regions(
    panel: Axes, edges: Sequence[np.ndarray], classes: np.ndarray, names: Mapping[int, str]
) -> list[Text]:
    """Write the name of its class into every region of a finished panel that has room for it."""
    # It is where the region is widest, and upright where only an upright name has room. `edges` are
    # those of the cells along abscissa and ordinate; `classes`, shape (rows, columns), are numbers.
    canvas.lay_out(panel)
    raster = _class_of_pixels(panel, edges, classes)
    scale = _PER_INCH / figure_of(panel).dpi

    def new_text(x: float, y: float, name: str) -> Text:
        """Return a text around a place of the panel, in shares of its width and height."""
        return panel.text(
            x, y, name, transform=panel.transAxes, size="x-small", color=ink(), zorder=6,
            ha="center", va="center_baseline", clip_on=True,
            path_effects=[withStroke(linewidth=1.8, foreground=ground())],
        )  # fmt: skip

    def box(name: str) -> tuple[int, int]:
        """Return the height and the width of a name with the space around it [px]."""
        text = new_text(0.5, 0.5, name)
        extent = text.get_window_extent()
        text.remove()
        sides = (extent.height, extent.width)
        height, width = (2 * _MARGIN + math.ceil(scale * side) for side in sides)
        return height, width

    texts = list[Text]()
    for name, row, column, upright in placed_names(raster, names, box, _free_of_marks(panel)):
        y, x = (np.array([row, column]) + 0.5) / raster.shape
        texts.append(new_text(x, y, name))
        if upright:  # at center_baseline it would be below its place
            texts[-1].set(rotation=90.0, va="center")
    return texts


def _shape_of(panel: Axes) -> tuple[int, int]:
    """Return the numbers of rows and columns of the pixels at which the room is measured."""
    box, scale = panel.get_window_extent(), _PER_INCH / figure_of(panel).dpi
    return max(2, round(box.height * scale)), max(2, round(box.width * scale))


def placed_names(
    classes: np.ndarray,
    names: Mapping[int, str],
    box: Callable[[str], tuple[int, int]],
    free: np.ndarray | bool = True,
) -> Iterator[tuple[str, int, int, bool]]:
    """Yield a name for each region with room in `free` pixels: row, column, if it is upright."""
    # `classes` are those of pixels; `box` returns the height and the width of a name in pixels.
    number, sizes = _regions(classes)
    count = 0
    for region in np.argsort(-sizes, kind="stable").tolist():
        if count >= _MOST_IN_PANEL or sizes[region] < 60:
            break
        rows, columns = np.nonzero(number == region)
        name = names.get(int(classes[rows[0], columns[0]]))
        if name is None:
            continue
        top, left = rows.min(), columns.min()
        inside = (number == region) & free
        shape = inside[top : rows.max() + 1, left : columns.max() + 1]
        height, width = box(name)
        level = _widest(shape, height, width)
        pixel = level or _widest(shape, width, height)
        if pixel is not None:
            yield name, int(top) + pixel[0], int(left) + pixel[1], level is None
            count += 1


def _class_of_pixels(panel: Axes, edges: Sequence[np.ndarray], classes: np.ndarray) -> np.ndarray:
    """Return the class in every pixel of a panel, from the bottom; -1 beside the cells."""
    indices = []
    for axis, (pixels, of_cells) in enumerate(zip(_shape_of(panel)[::-1], edges, strict=True)):
        middles = np.zeros((pixels, 2))
        middles[:, axis] = (np.arange(pixels) + 0.5) / pixels
        values = panel.transData.inverted().transform(panel.transAxes.transform(middles))[:, axis]
        indices.append(np.searchsorted(of_cells, values) - 1)
    x, y = (
        np.where((index < 0) | (index >= len(of_cells) - 1), -1, index)
        for index, of_cells in zip(indices, edges, strict=True)
    )
    raster: np.ndarray = np.where(np.minimum.outer(y, x) < 0, -1, classes[np.ix_(y, x)])
    return raster


def _free_of_marks(panel: Axes) -> np.ndarray:
    """Return the pixels of a panel without legend, texts, markers, discs and arrows."""
    from scipy.ndimage import maximum_filter

    shape, to_data = _shape_of(panel), panel.transData.inverted()
    markers = [np.asarray(line.get_xydata()) for line in panel.lines if line.get_marker() == "o"]
    discs = (patch for patch in panel.patches if isinstance(patch, Ellipse))
    lines = [to_data.transform(disc.get_verts()) for disc in discs]
    arrows = (text for text in panel.texts if isinstance(text, Annotation) and text.arrowprops)
    lines += [np.array([arrow.xyann, arrow.xy]) for arrow in arrows]
    obstacles = np.zeros(shape, bool)
    for points in markers:
        obstacles |= _pixels(panel, points, shape)
    for points in lines:
        obstacles |= _pixels(panel, points, shape, joined=True)
    free: np.ndarray = ~maximum_filter(obstacles, 2 * _HALF_MARKER + 1)
    texts = [text for text in panel.texts if text.get_text()]
    for part in filter(None, [panel.get_legend(), *texts]):
        box = part.get_window_extent()
        if isinstance(part, Text) and part.get_bbox_patch() is not None:
            box = box.padded(0.5 * box.height)  # a circle around a digit is within this
        corners = panel.transAxes.inverted().transform(box.get_points())
        low, high = np.clip(corners[:, ::-1], 0.0, 1.0) * shape
        free[int(low[0]) : math.ceil(high[0]), int(low[1]) : math.ceil(high[1])] = False
    return free


def _regions(classes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of the region of every cell, and the size of every region."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    cells = np.arange(classes.size, dtype=np.int32).reshape(classes.shape)  # for SciPy 1.11
    beside, above = classes[:, 1:] == classes[:, :-1], classes[1:] == classes[:-1]
    first = np.concatenate([cells[:, :-1][beside], cells[:-1][above]])
    second = np.concatenate([cells[:, 1:][beside], cells[1:][above]])
    joined = coo_array((np.ones(len(first), bool), (first, second)), (cells.size, cells.size))
    _, number = connected_components(joined, directed=False)
    return number.reshape(classes.shape), np.bincount(number)


def _widest(region: np.ndarray, height: int, width: int) -> tuple[int, int] | None:
    """Return the pixel where a region is widest and a box fits, nearest to its middle, or None."""
    from scipy.ndimage import distance_transform_edt, uniform_filter

    if region.shape[0] < height or region.shape[1] < width:
        return None
    share = uniform_filter(region.astype(float), (height, width), mode="constant")
    fits = share > _LEAST_SHARE
    if not fits.any():
        return None
    depth = np.where(fits, distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1], 0.0)
    pixels = np.argwhere(depth >= 0.9 * depth.max())
    middle = np.argwhere(region).mean(axis=0)
    row, column = pixels[np.argmin(np.hypot(*(pixels - middle).T))].tolist()
    return row, column


def draw_boundaries(panel: Axes, edges: Sequence[np.ndarray], classes: np.ndarray) -> None:
    """Draw the boundaries between the large regions of a map."""
    x, y = edges
    number, sizes = _regions(classes)
    large = (sizes >= max(9.0, _LARGE * classes.size))[number]
    across = (number[:, 1:] != number[:, :-1]) & large[:, 1:] & large[:, :-1]
    upwards = (number[1:] != number[:-1]) & large[1:] & large[:-1]
    row, column = np.nonzero(across)
    upright = np.stack([x[column + 1], y[row], x[column + 1], y[row + 1]], axis=1)
    row, column = np.nonzero(upwards)
    level = np.stack([x[column], y[row + 1], x[column + 1], y[row + 1]], axis=1)
    lines = list(np.concatenate([upright, level]).reshape(-1, 2, 2))
    props = {"colors": "black", "linewidths": 0.6, "capstyle": "round"}
    panel.add_collection(LineCollection(lines, rasterized=True, zorder=3, **props), autolim=False)


def _pixels(
    panel: Axes, points: np.ndarray, shape: Sequence[int], joined: bool = False
) -> np.ndarray:
    """Return the pixels of a panel, from the bottom, in which there are points, or their joints."""
    raster = np.zeros(shape, bool)
    places = in_panel(panel, points)[:, ::-1] * shape
    if joined and len(places) > 1:
        places = np.asarray(Path(places).interpolated(max(shape)).vertices)
    places = np.floor(places[np.isfinite(places).all(axis=1)]).astype(int)
    places = places[((places >= 0) & (places < shape)).all(axis=1)]
    raster[places[:, 0], places[:, 1]] = True
    return raster

"""Maps for print: names in the regions, greys and hatches, and the legend."""

import re
from functools import partial

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import Page, bifurcation, parameter_map, section
from sweeps.plotting.looks import period_cells
from sweeps.plotting.maps import entries_of
from sweeps.plotting.placed_names import placed_names
from sweeps.plotting.style import CLASSES, LOOKS
from tests.helpers.equal_points import equal_points, legend, legend_texts
from vibroimpact.status import Status

AXES = {"R": np.linspace(0.3, 0.9, 40), "omega": np.linspace(1.0, 4.0, 60)}


def blocks():
    """Return a map of 1/1 with a block of 2/2, a strip of 4/4, one cell of 8/8 and a rest."""
    dataset = equal_points(axes=AXES)
    for name in ("period", "period_impacts"):
        dataset[name].values[5:35, 20:35] = 2
        dataset[name].values[2:38, 40:42] = 4
        dataset[name].values[0, 0] = 8
    dataset["rest_fraction"].values[:, 48:] = 0.5
    return dataset


def names(figure):
    """Return the name, the place (R, omega) and the rotation of every text in the panel."""
    panel = figure.axes[0]
    figure.draw_without_rendering()
    found = []
    for text in panel.texts:
        at = text.get_transform().transform(text.get_position())
        omega, R = panel.transData.inverted().transform(at)
        found.append((text.get_text(), (R, omega), text.get_rotation()))
    return found


def test_every_name_is_in_a_region_of_its_class_and_has_room(with_layout):
    dataset = blocks()
    found = names(parameter_map(dataset))
    assert sorted(name for name, _, _ in found) == ["1/1", "2/2", "4/4", "rest, 1 period"]
    for name, (R, omega), rotation in found:
        there = dataset.sel(R=R, omega=omega, method="nearest")
        rests = there["rest_fraction"] > 0.0
        m, q = int(there["period"]), int(there["period_impacts"])
        assert name == ("rest, 1 period" if rests else f"{m}/{q}")
        assert rotation == (90.0 if name == "4/4" else 0.0)
    (widest,) = (place for name, place, _ in found if name == "2/2")
    np.testing.assert_allclose(widest, (0.6, 2.4), atol=0.1)  # the middle of its block


def test_a_name_is_where_its_region_is_widest():
    """A square with a long tail, in which the name would fit, too."""
    classes = np.zeros((40, 100), int)
    classes[10:30, :20] = classes[18:22, 20:] = 1
    ((_, row, column, _),) = placed_names(classes, {1: "1/1"}, lambda name: (3, 5))
    np.testing.assert_allclose((row, column), (20, 10), atol=2)


def test_names_are_those_of_the_shown_part():
    page = Page(xlim=(3.6, 4.0))
    assert [name for name, *_ in names(parameter_map(blocks(), page=page))] == ["rest, 1 period"]


def test_a_map_in_grey_has_no_colour_and_boundaries_between_regions():
    figure = parameter_map(blocks(), page=Page(grey=True))
    panel = figure.axes[0]
    colours = [to_hex(rgba) for mesh in panel.collections[:1] for rgba in mesh.get_cmap().colors]
    assert all(colour[1:3] == colour[3:5] == colour[5:] for colour in colours)
    assert legend(figure).keys() == {"1/1", "2/2", "4/4", "8/8", "rest, 1 period"}
    hatched = {patch.get_hatch() for patch in panel.patches}
    assert {LOOKS[2, 2][1].hatch, LOOKS[4, 4][1].hatch} <= hatched
    (lines,) = (lines for lines in panel.collections if hasattr(lines, "get_segments"))
    ends = np.concatenate(lines.get_segments())
    step = AXES["omega"][1] - AXES["omega"][0]
    at = {round(float(x - 1.0) / step, 1) for x in ends[:, 0]}
    assert {19.5, 34.5, 39.5, 41.5, 47.5} <= at  # the sides of the blocks
    assert not {0.5, 1.5} & {round(float(x - 1.0) / step, 1) for x in ends[ends[:, 1] < 0.31, 0]}


def test_the_commonest_rest_stands_for_the_share_of_all():
    dataset = equal_points(axes=AXES)
    dataset["rest_fraction"].values[:5, 0] = 0.5
    dataset["period"].values[:2, 0] = 2
    cut = OpenedSweep(dataset)
    entries = entries_of(cut, period_cells(*cut.classes))
    shares = {entry.get_label(): share * cut["status"].size for entry, share in entries.items()}
    assert shares == pytest.approx({"1/1": 2395, "rest, 1 period": 5, "rest, 2 periods": 2})


def map_of(shares, rows, columns, order, **changed):
    """Return a map of motions in shares in per cent: column by column, or in an order by chance."""
    axes = {"R": np.linspace(0.3, 0.9, rows), "omega": np.linspace(1.0, 4.0, columns)}
    dataset = equal_points(axes=axes, **changed)
    counts = [round(0.01 * rows * columns * share) for share in shares.values()]
    kinds = order(np.repeat([*shares], counts)).reshape(columns, rows).T
    for name in shares:
        here, digits = kinds == name, [int(each) for each in re.findall(r"\d+", name)] or [0]
        dataset["period"].values[here] = digits[0]
        dataset["period_impacts"].values[here] = digits[-1]
        dataset["rest_fraction"].values[here] = 0.5 * name.startswith("rest")
        dataset["lyapunov"].values[here] = 0.5 if name == "chaotic" else -0.3
    return dataset


#: Shares of the classes in per cent.
SHARES = {f"{m}/{q}": 1 for m, q in CLASSES}
SHARES |= {"1/1": 27, "2/1": 24, "1/2": 8, "3/1": 6, "2/2": 5}


def many_entries():
    """Return a map with all classes in shares, and as many further entries as there can be."""
    shares = SHARES | {"5/1": 11, "rest, 5 periods": 3, "chaotic": 3, "unknown": 4}
    status = {(0, 0): Status.UNRESOLVED, (1, 0): Status.NON_FINITE, (2, 0): Status.PENDING}
    near = {(row, 1): 0.1 for row in range(5)}
    return map_of(shares, 10, 100, np.asarray, status=status, orbit_distance=near)


def entries(legend):
    return [text.get_text().split(",")[0] for text in legend.get_texts()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "height", "grey"),
    [(2.4, None, True), (3.4, 2.6, False), (7.0, None, True)],
)
def test_a_legend_has_the_commonest_classes_on_every_page(width, height, grey, with_layout):
    """The page becomes higher for them, if it may; only rarer ones are left out, and counted."""
    figure = parameter_map(many_entries(), page=Page(width=width, height=height, grey=grey))
    figure.draw_without_rendering()
    (one,) = figure.legends
    shown = entries(one)
    share = SHARES | {"rest": 3.01, "chaotic (3.01 %)": 3.01, "unknown (4.01 %)": 4.01}
    left_out = [of for text, of in share.items() if text not in shown]
    kept = [of for text, of in share.items() if text in shown]
    assert max(left_out, default=0) <= min(kept) and (height or {*left_out} <= {1})
    assert one.get_window_extent().height < 0.203 * figure.bbox.height
    if height:
        assert shown[-1].endswith(" more")
        return
    panel = figure.axes[0].get_window_extent().height / figure.dpi
    assert 2.0 < panel < 1.5 * 3.2
    if width > 3.0:
        left_out = 14 + 7 + 1 - len([text for text in shown if not text.endswith(" more")])
        assert (f"{left_out} more" in shown) == (left_out > 0)
        assert {"1/1", "unresolved", "non-finite", "not computed yet (1 of 1"} <= set(shown)


@pytest.mark.slow
def test_a_legend_within_a_panel_does_not_bury_it(with_layout):
    figure = Figure(layout="constrained")
    panel, _ = figure.subplots(1, 2)
    parameter_map(many_entries(), ax=panel)
    figure.draw_without_rendering()
    one = panel.get_legend()
    shown, box = entries(one), one.get_window_extent()
    assert shown[0] == "1/1" and shown[-1].endswith(" more")
    within = panel.get_window_extent()
    assert box.height < 0.203 * within.height and box.width < within.width
    assert within.x0 < box.x0 and box.x1 < within.x1


#: Shares in per cent of motions that are scattered over a map, so that no region has a name.
SCATTERED = {
    "1/1": 20, "2/1": 13, "3/1": 6, "1/2": 5, "2/2": 4, "4/2": 3, "2/3": 2.5, "1/3": 3, "5/2": 2.5,
    "9/7": 1, "rest, 1 period": 1.9, "rest, 2 periods": 1.5, "rest, 6 periods": 1.5, "rest": 1.5,
    "rest, 13 periods": 1.4, "rest, 5 periods": 0.3, "rest, 7 periods": 0.3,
    "rest, 9 periods": 0.3, "3/3": 1, "4/4": 1, "8/8": 0.5,
}  # fmt: skip


def scattered():
    """Return a map of motions in shares, in an order by chance; the others are chaotic."""
    by_chance = np.random.default_rng(1).permutation
    return map_of(SCATTERED | {"chaotic": 28.8}, 40, 50, by_chance)


def bent_curves(count):
    """Return as many curves as `sweeps.curves` would over the scattered map, from edge to edge."""
    across = np.linspace(1.0, 4.0, 30)
    rows = [(across, np.full(30, 0.3 + 0.6 * (i + 0.5) / count), i) for i in range(count)]
    omega, R, number = (np.concatenate(each) for each in zip(*[
        (x, y, np.full(30, i)) for x, y, i in rows], strict=True))  # fmt: skip
    kinds = np.array(["flip", "fold", "graze"])[number % 3]
    about = {"curve": number, "kind": kinds, "special": np.full(len(number), "")}
    about |= {"m": np.ones(len(number), int), "q": np.ones(len(number), int)}
    data = {name: ("point", values) for name, values in about.items()}
    return xr.Dataset(data, {"omega": ("point", omega), "R": ("point", R)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height", "grey", "exact"), [(None, False, None), (5.0, True, bent_curves(40))]
)
def test_every_class_above_two_per_cent_has_a_name(height, grey, exact, with_layout):
    """Sums and marks are judged by what they cover, as the classes are."""
    page = Page(width=3.4, height=height, grey=grey)
    figure = parameter_map(scattered(), exact=exact, page=page)
    figure.draw_without_rendering()
    shown = legend_texts(figure)
    for name, share in SCATTERED.items():
        if share >= 2.0:
            assert any(re.search(rf"(^|[ :,]){name}($|,)", text) for text in shown), name
    assert any(text.startswith("rest") for text in shown)  # 8 % in sum
    assert not any("further curve" in text for text in shown)
    if rests := [text for text in shown if text.endswith("... periods")]:
        assert "13" in rests[0]


def test_curves_and_meetings_have_a_name_before_classes(with_layout):
    curves = bent_curves(40)
    curves["special"] = curves["special"].astype("U4")
    curves["special"].values[1::2] = "flip"
    shown = legend_texts(parameter_map(scattered(), exact=curves, page=Page(width=3.4)))
    assert shown[-1].endswith(" more") and {"flip", "fold", "graze", "cusp or meeting"} <= {*shown}


def test_entries_of_one_width_are_beside_each_other_in_a_legend_within_the_figure(with_layout):
    """So that more columns fit, and fewer classes are left out."""
    changed = {"orbit_distance": {(0, 0): 0.1}, "rest_fraction": {(0, 3): 0.5}}
    dataset = equal_points(axes=AXES, period={(1, 1): 0}, **changed)
    for column, (m, q) in enumerate(list(CLASSES)[1:7]):
        dataset["period"].values[2:, 8 * column :] = m
        dataset["period_impacts"].values[2:, 8 * column :] = q
    dataset["period_impacts"].values[1, 6] = 7
    figure = parameter_map(dataset, page=Page(width=3.4))
    figure.draw_without_rendering()
    (one,), texts = figure.legends, legend_texts(figure)
    assert {"rest, 1 period", "other m/q"} <= {*texts}
    assert [*map(len, texts)] == sorted(map(len, texts))
    box = one.get_window_extent()
    assert figure.bbox.x0 < box.x0 and box.x1 < figure.bbox.x1
    assert len({round(text.get_window_extent().x0) for text in one.get_texts()}) >= 3


def test_marks_can_be_left_out():
    dataset = equal_points(axes=AXES)
    dataset["orbit_distance"].values[3:9, 3:9] = 0.5
    assert parameter_map(dataset).axes[0].patches
    assert not parameter_map(dataset, page=Page(marks=False)).axes[0].patches
    assert not parameter_map(dataset, page=Page(legend=False)).legends


def test_a_look_that_a_picture_does_not_have_is_refused():
    dataset = equal_points(axes=AXES)
    with pytest.raises(Refused, match="only maps and diagrams can leave out marks"):
        section(dataset, page=Page(marks=False))
    with pytest.raises(Refused, match="grey = 1 is not allowed; expected: True or False"):
        Page(grey=1)


@pytest.mark.parametrize(
    ("draw", "part"),
    [(parameter_map, slice(85, 98)), (partial(bifurcation, color="period"), slice(0, 12))],
)
def test_the_legend_of_a_part_has_the_shares_of_the_part(draw, part):
    dataset = many_entries() if draw is parameter_map else many_entries().isel(R=[0])
    cut = dataset.isel(omega=part)
    page = Page(xlim=tuple(cut["omega"].values[[0, -1]].tolist()))
    seen, alone, whole = (
        {*legend_texts(draw(data, page=limits))}
        for data, limits in ((dataset, page), (cut, page), (dataset, Page()))
    )
    assert seen == alone != whole

"""Pictures for print, panels below a diagram, titles, limits and use from Python."""

import shutil
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from PIL import Image

from sweeps import branches, plotting
from sweeps.attractor.knocks import Knock
from sweeps.errors import Refused
from sweeps.plotting import Page
from sweeps.plotting.saving import save, save_chart
from sweeps.plotting.style import user_style
from tests.helpers.commands import call
from tests.helpers.equal_points import legend_texts
from tests.helpers.sweep_files import swept
from tests.sweeps.plotting.test_overlay import RIG
from vibroimpact import Oscillator, one_impact_orbit, simulate

pytestmark = pytest.mark.slow

MAP = """
name: a map with a name that is long enough to need two lines on a page of one column
oscillator: {h: 0.05, R: [0.6, 0.8], omega: {start: 2.2, stop: 3.4, num: 13}, f: 1.0}
record: {transient: 100, periods: 32, impacts: 16, diagnostics: [period, lyapunov]}
"""
STARTS = """
name: starts
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}
start: {x0: {start: -3, stop: 0.5, num: 6}, v0: {start: -3, stop: 3, num: 6}}
record: {transient: 200, periods: 32, diagnostics: [period]}
"""
TABLE = """\
points: {h: [0.1, 0.02, 0.05], R: [0.8, 0.7, 0.75], omega: [2.4, 2.6, 2.9], p: [1.0, 1.1, 1.2]}
oscillator: {f: 1.0}
"""
FILES = {"map": MAP, "starts": STARTS, "table": TABLE, "rig": RIG}


@pytest.fixture
def dataset(loaded):
    return loaded["map"]


@pytest.fixture
def draw(files):
    """Return a function that draws map.h5 with the command line."""
    shutil.copy(files / "map.h5", "map.h5")
    return lambda *arguments: call("plot", "map.h5", *arguments)


def visible_texts(figure):
    """Return the visible texts and their boxes [pt]."""
    figure.draw_without_rendering()
    hidden = hidden_ticks(figure)
    boxes = []
    for text in figure.findobj(Text):
        box = text.get_window_extent()
        if text.get_visible() and text.get_text().strip() and text not in hidden:
            boxes.append((text, box))
    return boxes


def hidden_ticks(figure):
    """Return the labels of ticks outside the limits of their axes."""
    labels = set()
    for panel in figure.axes:
        for axis, limits in ((panel.xaxis, panel.get_xlim()), (panel.yaxis, panel.get_ylim())):
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not min(limits) - 1e-9 <= tick.get_loc() <= max(limits) + 1e-9:
                    labels |= {tick.label1, tick.label2}
    return labels


NARROW = [
    ("map", "bifurcation", {"exact": [(1, 1), (2, 1)], "coordinate": "impact_phase"}),
    ("map", "map", {"quantity": "lyapunov"}),
    ("map", "bifurcation", {"color": "impacts_per_period", "below": "lyapunov"}),
    ("map", "section", {"color": "period"}),
    ("starts", "trajectory", {"color": "x0", "at": {"v0": 0.6}}),
    ("rig", "trajectory", {"at": {"frequency": 27}}),
    ("starts", "basins", {}),
    ("starts", "integrity", {}),
    ("table", "table", {"color": "slowest_impact"}),
]


@pytest.mark.parametrize(("file", "kind", "options"), NARROW)
@pytest.mark.usefixtures("with_layout", "no_knocks")
def test_on_a_column_nothing_collides_and_all_is_legible(loaded, monkeypatch, file, kind, options):
    knock = Knock(0.5, -1.0, 0.0, 0.5, 1.0, 0)
    monkeypatch.setattr("sweeps.attractor.knocks._Attractors.worst", lambda *_: knock)
    if "exact" in options:
        options = {**options, "exact": branches(loaded[file], classes=options["exact"])}
    figure = plotting.KINDS[kind].draw(loaded[file], page=Page(width=3.4), **options)
    assert figure.get_figwidth() == pytest.approx(3.4)
    texts = visible_texts(figure)
    assert len(texts) > 8
    if kind == "integrity":
        assert any("least knock, 2/1" in text.get_text() for text, _ in texts)
    page = figure.bbox
    for text, box in texts:
        small = "_" in text.get_text() or "^" in text.get_text()
        size = text.get_fontsize() * (0.7 if small else 1)
        assert size >= 6.0, text
        assert box.x0 >= page.x0 - 1 and box.x1 <= page.x1 + 1, text
        assert box.y0 >= page.y0 - 1 and box.y1 <= page.y1 + 1, text
    for (one, a), (other, b) in combinations(texts, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert wide <= 1.0 or high <= 1.0, (one, other)


def test_no_tick_label_is_cut_at_any_width(dataset, tmp_path, with_layout):
    """Panels of another width have other ticks, of which the last is at the end of the axis."""
    values = np.linspace(2.0, 12.0, dataset.sizes["omega"])
    dataset = dataset.assign_coords(omega=("omega", values, dataset["omega"].attrs))
    for width in np.arange(2.6, 3.8, 0.4):
        figure = plotting.bifurcation(dataset, page=Page(width=width, title=""))
        save(figure, tmp_path / "page.png")
        assert (imread(tmp_path / "page.png")[:, [0, -1], :3] > 0.9).all(), width


def test_two_parameters_with_a_period_give_a_map_and_a_value_that_was_not_chosen_is_said(
    draw, unpainted, monkeypatch
):
    def drawing(kind, *_, **__):
        drawn.append(kind.function)
        return Figure()

    drawn = []
    monkeypatch.setattr(plotting.api.Kind, "draw", drawing)
    said = "R = 0.6, the first of 2: plot --at R=VALUE takes another\n"
    for choice, kind, told in (
        ([], "parameter_map", ""),
        (["--kind", "map"], "parameter_map", ""),
        (["--kind", "bifurcation"], "bifurcation", said),
        (["--axis", "R"], "bifurcation", "omega = 2.2, the first of 13: plot --at omega=VALUE "
         "takes another\n"),
        (["--at", "R=0.8"], "bifurcation", ""),
        (["--coordinate", "poincare_v"], "bifurcation", said),
    ):  # fmt: skip
        result = draw(*choice)
        assert (result.exit_code, result.stderr, drawn.pop()) == (0, told, kind)
    assert draw("--kind", "section").stderr.count("the first of") == 2


def test_a_scalar_is_drawn_below_on_the_same_axis(dataset):
    figure = plotting.bifurcation(dataset, below=["lyapunov", "rest_fraction"], at={"R": 0.8})
    diagram, exponents, rest = figure.axes
    line = dataset.sel(R=0.8)
    for number in (0, 1):
        drawn = exponents.lines[number].get_xydata()
        values = line["lyapunov"].isel(exponent=number).values
        np.testing.assert_array_equal(drawn, np.stack([line["omega"].values, values], axis=1))
    first, second, _, *legend = exponents.lines  # told apart by size, however dense the dots are
    assert [line.get_alpha() for line in (first, second, *legend)] == [1.0, 1.0, None, None]
    sizes = [line.get_markersize() for line in (first, second, *legend)]
    assert sizes[0] / sizes[1] == sizes[2] / sizes[3] == 2.0
    assert exponents.get_title("left") == r"Lyapunov exponent $\lambda$"
    assert diagram.get_xlim() == rest.get_xlim()
    assert not diagram.get_xlabel() and "omega" in rest.get_xlabel()
    assert legend_texts(figure) == ["on its way to m/q (3 of 13)", r"$\lambda_1$", r"$\lambda_2$"]


def test_the_dots_of_attractors_of_many_starts_are_visible():
    """Chaotic ones, too, on a screen of 100 pixels per inch."""
    axis = {"start": 2.7, "stop": 2.95, "num": 200}
    oscillator = {"h": 0.02, "R": 0.8, "omega": axis, "f": 1.0}
    record = {"transient": 100, "periods": 32}
    start = {"v0": [0.0, 0.5]}
    dataset = swept({"oscillator": oscillator, "start": start, "record": record})
    panel = plotting.attractor_diagram(dataset).axes[0]
    sizes = [line.get_markersize() for line in panel.lines if len(line.get_xdata())]
    assert len(sizes) > 2 and min(sizes) > 72.0 / 100.0


def test_the_impacts_of_attractors_are_drawn_beside_one_without_impacts():
    """It has no dot, and is in the legend."""
    oscillator = {"h": 0.1, "R": 0.8, "omega": [2.5, 2.6], "f": 1.0, "clearance": 0.6}
    start = {"x0": {"start": -2, "stop": 0.5, "num": 4}, "v0": [-1.0, 1.0]}
    dataset = swept({"oscillator": oscillator, "start": start})
    figure = plotting.attractor_diagram(dataset, coordinate="impact_v")
    (dots,) = [line for line in figure.axes[0].lines if len(line.get_xdata())]
    assert {*dots.get_xdata().tolist()} == {2.5, 2.6}
    assert legend_texts(figure) == ["1/0, no impact", "2/1"]


SLOW = """
oscillator: {h: 0.05, R: 0.9, omega: [0.2, 0.25, 2.3], f: 1.0}
record: {transient: 20, periods: 10, diagnostics: [period]}
"""


def test_impacts_and_sections_that_are_left_out_are_said():
    """122 impacts in a period at omega = 0.2, as `simulate` counts them; 64 are kept."""
    dataset = swept(SLOW)
    turn = 2.0 * np.pi / 0.2
    motion = simulate(Oscillator(h=0.05, R=0.9, omega=0.2, f=1.0), periods=30)
    most = f"{int((motion.impact_t > 20 * turn).sum()):,}"
    last, up_to, cut = "last 64 of", f"up to {most} impacts", dataset.isel(section=slice(-3, None))
    for figure, said, part in (
        (plotting.bifurcation(dataset, coordinate="impact_v"), f"{last} {up_to}", True),
        (plotting.bifurcation(dataset, coordinate="poincare_x"), "", False),
        (plotting.impacts(dataset, at={"omega": 0.2}), f"{last} {most} impacts", False),
        (plotting.impacts(dataset, at={"omega": 2.3}), "", False),
        (plotting.impacts(dataset, color="period"), f"{last} {up_to}", False),
        (plotting.impacts(dataset.isel(impact=slice(9)), color="period"), f", 9 of {up_to}", False),
        (plotting.section(dataset), "", False),
        (plotting.section(cut), "3 of 10 sections", False),
        (plotting.bifurcation(cut, coordinate="impact_v"), f"{last} {up_to}", True),
    ):
        title = figure.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")
        assert title.endswith(said or "record 10 periods")
        assert ("only part of a repetition (1 of 3)" in legend_texts(figure)) == part
    said = "; the file has only the last 64 of up to {} impacts of a point"
    for rows, text in (("impacts", said.format(most)), ("sections", "")):
        told = call("export", "swept.h5", "-o", "a.csv", "--rows", rows).stdout
        assert told.endswith(f" rows{text}\n")


def test_width_title_and_limits_by_the_command(draw):
    arguments = ["--kind", "bifurcation", "--width", "86.36mm", "--title", "A title"]
    with mpl.rc_context({"savefig.dpi": mpl.rcParamsDefault["savefig.dpi"]}):
        assert draw(*arguments, "--xlim", "2.5:3", "--ylim", "-0.5:0").exit_code == 0
    assert imread("map-bifurcation.png").shape[1] == pytest.approx(3.4 * 300, abs=1)
    assert draw(*arguments, "--height", "5cm", "--dpi", "100").exit_code == 0
    assert imread("map-bifurcation.png").shape[:2] == (pytest.approx(197, abs=1), 340)
    drawn = set()
    for looks in ((), ("--grey",), ("--no-legend",), ("--no-marks",)):
        assert draw("--kind", "bifurcation", "--dpi", "40", *looks, "-o", "a.png").exit_code == 0
        drawn.add(imread("a.png").tobytes())
    assert len(drawn) == 4
    for option, value in (("--width", "3.4"), ("--width", "0in"), ("--height", "3"), ("--dpi", "0"),
                          ("--xlim", "3:2"),
                          ("--ylim", "1"), ("--xlim", "nan:1")):  # fmt: skip
        wrong = draw(option, value)
        assert wrong.exit_code == 2
        assert f"{option} {value} is not allowed; expected: " in wrong.stderr


def test_a_motion_goes_on_from_the_stored_state(dataset):
    """On the closed-form orbit at omega = 2.3: one impact per period, at its speed."""
    figure = plotting.trajectory(dataset, at={"omega": 2.3, "R": 0.8}, periods=3)
    over_time, velocity, _ = figure.axes
    orbit = one_impact_orbit(Oscillator(h=0.05, R=0.8, omega=2.3, f=1.0))
    (impacts,) = [line for line in velocity.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(impacts.get_ydata(), 3 * [orbit.v], rtol=1e-6)
    t, x = over_time.lines[0].get_xydata().T
    assert t[0] == 0.0 and t[-1] == pytest.approx(3 * 2.0 * np.pi / 2.3)
    first = dataset["poincare_x"].sel(omega=2.3, R=0.8, method="nearest").values[-1]
    assert x[0] == first
    assert np.diff(t).max() < 2.0 * np.pi / 2.3 / 199  # no corners
    assert x.max() < 1e-9
    assert "after 132 forcing periods" in figure.get_suptitle()


def test_the_attractors_are_marked_in_their_basins(loaded):
    """The free oscillation, at its closed form, and one impact in a period, at its own."""
    panel = plotting.basins(loaded["starts"]).axes[0]
    marks = np.concatenate([line.get_xydata() for line in panel.lines])
    osc = Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0, clearance=0.6)
    stiffness = (1.0 - osc.omega**2) + 2j * osc.h * osc.omega
    amplitude = -osc.f / stiffness
    free = np.array([amplitude.imag, osc.omega * amplitude.real])
    assert np.abs(marks - free).max(axis=1).min() < 1e-9
    assert panel.get_xlim() == pytest.approx((-3.35, 0.85))


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_a_picture_says_where_it_comes_from(dataset, tmp_path, monkeypatch, ending):
    """And the same picture gives the same bytes at any time. For EPS see test_postscript.py."""
    output, options = tmp_path / f"a.{ending}", {"command": "vibroimpact plot map.h5"}
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    plotting.plot(dataset, output, "section", page=Page(dpi=60), **options)
    if ending == "png":
        with Image.open(output) as image:
            text = " ".join(image.text.values())
    else:
        text = output.read_bytes().decode("latin-1")
    for part in ("vibroimpact 0", "numerics", "vibroimpact plot map.h5", "transient: 100",
                 "a map with a name"):  # fmt: skip
        assert part in text
    again = tmp_path / f"b.{ending}"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    plotting.plot(dataset, again, "section", page=Page(dpi=60), **options)
    assert again.read_bytes() == output.read_bytes()


def test_settings_of_the_user_are_kept(dataset, tmp_path, with_layout):
    own = {"font.size": 6.0, "figure.figsize": [4.0, 2.0], "savefig.dpi": 50.0}
    with mpl.rc_context(own):
        figure = plotting.bifurcation(dataset)
        panel = figure.axes[0]
        texts = [*figure.texts, panel.xaxis.label, panel.yaxis.label, *panel.get_xticklabels()]
        assert {text.get_fontsize() for text in texts} == {6.0}
        parts = (figure.texts[0], figure.legends[0])
        room = sum(part.get_window_extent().height for part in parts) / figure.dpi
        assert figure.get_size_inches() == pytest.approx([4.0, 2.0 + room])
        plotting.plot(dataset, tmp_path / "a.png", kind="bifurcation")
        titled = Figure()
        save_chart(tmp_path / "b.png", lambda: titled.suptitle("of a bench").figure)
        assert {text.get_fontsize() for text in titled.texts} == {6.0}
    assert imread(tmp_path / "a.png").shape[1] == 200
    assert plotting.bifurcation(dataset).axes[0].xaxis.label.get_fontsize() == 9.0
    assert mpl.rcParams["font.size"] == mpl.rcParamsDefault["font.size"]


def test_a_setting_that_the_user_names_is_kept_where_it_is_matplotlibs_own():
    assert user_style()["font.size"] == 9.0
    Path("matplotlibrc").write_text("font.size: 10\n")
    assert "font.size" not in user_style() and "pdf.fonttype" in user_style()


def test_a_panel_of_another_figure_is_drawn_into(dataset):
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert plotting.bifurcation(dataset, ax=left) is figure
    assert plotting.parameter_map(dataset, ax=right, page=Page(title="right")) is figure
    assert left.lines and right.collections and right.get_title() == "right"
    assert not figure.legends and right.get_legend() is not None
    three = Figure().subplots(3)
    assert plotting.trajectory(dataset, ax=three) is three[0].figure


@pytest.mark.parametrize(
    ("kind", "options", "layout"),
    [
        ("map", {"quantity": "impulse"}, None),
        ("map", {"quantity": "impulse"}, "tight"),
        ("section", {"color": "impulse"}, "constrained"),
    ],
)
def test_a_bar_is_clear_of_the_labels_of_its_panel(dataset, with_layout, kind, options, layout):
    ax = Figure(figsize=(7.0, 3.0), layout=layout).subplots(1, 2)[1]
    figure = plotting.KINDS[kind].draw(dataset, ax=ax, **options)
    figure.draw_without_rendering()
    bar = figure.axes[-1]
    assert bar.bbox.y1 <= ax.xaxis.get_tightbbox().y0
    assert ax.bbox.height > bar.bbox.height > 0.0


@pytest.mark.parametrize("projection", ["polar", "3d", "mollweide"])
def test_a_panel_whose_axes_are_not_straight_is_refused(dataset, projection):
    panels = Figure().subplots(1, 3, subplot_kw={"projection": projection})
    for kind in ("bifurcation", "map", "section", "trajectory"):
        ax = panels if kind == "trajectory" else panels[0]
        with pytest.raises(Refused, match=r"ax = .* not allowed; expected: .* two straight axes"):
            plotting.KINDS[kind].draw(dataset, ax=ax)


def test_a_panel_that_shows_nothing_is_refused(dataset):
    removed, elsewhere = Figure().subplots(2)
    flat = removed.figure.add_axes((0.1, 0.1, 0.0, 0.5))
    removed.remove()
    elsewhere.set_xlim(5.0, 6.0)  # its user may change them
    for panel in (removed, flat):
        with pytest.raises(Refused, match=r"ax = .* is not allowed; expected: a panel of a figure"):
            plotting.parameter_map(dataset, ax=panel)
    plotting.bifurcation(dataset, ax=elsewhere)


def test_a_height_that_leaves_nothing_of_the_panels_is_refused(dataset, with_layout):
    with pytest.raises(Refused, match=r"height = 1\.2 in .*; expected: at least 2 in, of which"):
        plotting.bifurcation(dataset, page=Page(width=3.4, height=1.2))
    assert plotting.bifurcation(dataset, page=Page(height=2.5, title="")).get_figheight() == 2.5

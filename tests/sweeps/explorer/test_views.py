"""The live picture without a browser: views, their diagrams and pixels, and what is refused."""

import re
import shlex
import sys
from collections import defaultdict
from dataclasses import asdict, replace

import numpy as np
import pytest
from bokeh.models import GlyphRenderer, LogScale

import sweeps
from sweeps import ConfigError, Refused, load_config, open_sweep, run_sweep
from sweeps.engine.executors import compute_all
from sweeps.explorer.live_diagram import Diagram, density, ordinates, ramp
from sweeps.explorer.live_motion import motion_at
from sweeps.explorer.view import BASINS_TAB, DIAGRAM_TAB, MAP_TAB, View, window_bounds, write_yaml
from sweeps.plotting.style import PARTIAL
from tests.helpers.commands import refused
from tests.helpers.configurations import load
from tests.helpers.places import CONFIGS
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.oscillator import PARAMETERS, Oscillator
from vibroimpact.status import Status

SCENES = [path for path in sorted(CONFIGS.glob("*.yaml")) if path.stem != "tolerances"]  # a table


def shown(view):
    """Return the figure of the diagram with a view, without a page."""
    diagram = Diagram(lambda *_: None)
    diagram.show(view)
    return diagram


def test_a_picture_that_comes_late_leaves_the_ordinate_of_a_newer_view(view):
    """And the picture of a zoom does not fit all points."""
    diagram, zoomed = shown(view), replace(view, ylim=(-0.2, -0.1))
    late = diagram._draw(view, view.diagram(20), 30)
    diagram.show(zoomed)
    for seen, picture in ((view, late), (zoomed, diagram._draw(zoomed, zoomed.diagram(9), 20))):
        diagram._paint(picture, 0.0)
        y = diagram.figure.y_range
        assert (y.start, y.end) == (-0.2, -0.1)
        assert (diagram.source.data["fit"][0] == picture.window) == (seen is view)


def test_the_diagram_records_on_and_throws_nothing_away(view):
    view = replace(view, record={**view.record, "transient": 20, "periods": 3})
    diagram = Diagram(lambda *_: None)
    diagram.size = (40, 30)
    drawn = [step.compute() for step in diagram.steps(view)]
    assert [len(each.values) for each in drawn] == [16, 40, 40, 40, 40]
    assert [each.config.record.periods for each in drawn] == [3, 3, 12, 48, 192]
    first, last = (drawn[i].results["poincare_x"] for i in (1, -1))
    np.testing.assert_array_equal(last[:, :3], first)
    (step,) = diagram.steps(replace(view, ylim=(-0.4, -0.3)))
    assert step.compute().results is drawn[-1].results
    assert diagram.snapshot is not None and diagram.snapshot.config == drawn[-1].config


def test_the_height_is_that_above_the_stop_of_each_column(view):
    config = replace(view, axis="clearance", xlim=(0.0, 2.0)).diagram(4)
    results = compute_all(config.sweep)
    expected = np.linspace(0.0, 2.0, 4)[:, None] - results["poincare_x"]
    np.testing.assert_array_equal(ordinates(config, results, "poincare_height"), expected)


def test_the_motion_at_a_stop_that_presses(view):
    """The orbit in closed form, and a line through its impacts that stays below the stop."""
    osc = Oscillator(h=0.05, R=0.7, omega=2.3, f=1.0, clearance=-0.2)
    drawn = motion_at(view.moved(**asdict(osc), x0=-0.5))
    closed = one_impact_orbit(osc)
    assert closed.stable and drawn.text.startswith("settled on 1/1")
    np.testing.assert_allclose(drawn.impacts[2], [closed.v] * 4, rtol=1e-6)
    assert drawn.line[1].max() == -0.2
    assert np.diff(drawn.line[0]).max() <= osc.forcing_period / 64 * (1.0 + 1e-9)
    assert motion_at(view.moved(omega=2.95)).text.startswith("chaotic; Lyapunov exponents 0.")


def test_a_table_has_no_page():
    with pytest.raises(Refused, match="rows of a table as points"):
        sweeps.explore(load_config(CONFIGS / "tolerances.yaml"))


def test_the_page_computes_the_default_transient_where_a_run_finds_it():
    view = View.of(load_config(CONFIGS / "quickstart.yaml", ["record.transient=auto"]))
    view.checked()
    assert view.record["transient"] == view.diagram(4).record.transient == 1000


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_can_be_looked_at_and_every_parameter_be_an_axis(path):
    view = View.of(load_config(path)).checked()
    assert view.tab == (BASINS_TAB if {view.axis, view.across} == {"x0", "v0"} else DIAGRAM_TAB)
    for name in PARAMETERS:
        view.with_axis(name).checked()
        if name != view.axis:
            replace(view.with_across(name), tab=MAP_TAB).checked()


def test_the_windows_are_of_the_size_of_the_motion():
    """The gap is half a millimetre, and the deflection by the force one; p is 126 per second."""
    view = View.of(load_config(CONFIGS / "joint-clearance.yaml"))
    assert view.x0lim[0] == pytest.approx(0.0005 - 0.003) and view.x0lim[1] == 0.0005
    assert view.v0lim == pytest.approx((-0.253, 0.253), abs=1e-3)
    assert view.with_axis("clearance").xlim == pytest.approx((0.0, 0.0025))
    assert view.moved(clearance=2e-4).x0lim == pytest.approx((-0.0028, 2e-4))  # before the stop
    assert replace(view, ylim=(0.0, 1e-3)).with_axis("R").ylim is None


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_an_axis_ends_near_zero_in_every_unit_of_time(unit):
    """Two rates are never zero, so their axes end above it; a configuration may begin below."""
    omega = {"start": 0.8 * unit, "stop": 4.0 * unit, "num": 50}
    scene = {"h": 0.1 * unit, "R": 0.8, "omega": omega, "f": unit**2, "p": unit}
    view = View.of(load_config({"oscillator": scene}))
    for name in ("omega", "p"):
        low, _ = window_bounds(name, view, (0.5 * unit, unit))
        assert 0.0 < low < 0.01 * unit
    assert window_bounds("omega", view, (1e-9 * unit, unit))[0] == 1e-9 * unit


@pytest.mark.parametrize("axis", PARAMETERS)
def test_a_view_returns_from_its_address(view, axis):
    changed = replace(
        view.moved(R=1 / 3, clearance=0.1),
        axis=axis,
        xlim=(0.1, 0.7),
        ylim=(-1e-9, 0.1 + 0.2),
        record={**view.record, "transient": 7, "phase": 1.1},
        marked=True,
        ordinate="impact_v",
        across="h" if axis != "h" else "R",
    )
    changed = replace(changed, xlim=(-0.7, 0.1)) if axis == "x0" else changed
    assert view.with_query("?" + changed.query()).checked() == changed


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("R=1.5", "^R = 1.5 is not allowed; expected: a number from 0 to 1$"),
        ("f=1e308", r"^f = 1e\+308 is not allowed; expected: up to 4e\+307$"),
        ("omega=fast", "^omega = fast is not a number; expected: a finite number > 0"),
        ("omega=1_0", "^omega = 1_0 is not a number; expected: a finite number > 0"),
        ("R=", "^R =  is not a number; expected: a number from 0 to 1"),
        ("x0=1", "lies beyond the stop"),
        ("xlim=3:2", "the window xlim = .* is empty or too narrow"),
        ("xlim=2.7:2.70000000000001", r"the window xlim = \(2.7, 2.70000000000001\) is empty or"),
        ("ylim=-1e-3:-0.000999999999999999", "the window ylim = .* is empty or too narrow"),
        ("ylim=nan:1", "the window ylim = .* is empty or too narrow"),
        ("xlim=-1:2", "contains -1, which is not allowed"),
        ("axis=mass", "axis = 'mass' is not allowed; expected: one of h, R"),
        ("across=omga", "across = 'omga' is not .*did you mean omega"),
        ("axis=R&across=R", "^R is asked for as both axes of the map$"),
        ("ordinate=z", "ordinate = 'z' is not allowed; expected: one of poincare_x"),
        ("transient=-1", "record.transient = -1 is not allowed"),
        ("transient=auto", "^transient = auto is not for the live page; expected: an integer$"),
        ("section=7", "record.phase = 7 is not allowed"),
        ("phase=7", "^phase = 7 is not allowed; expected: a number >= 0 and < 2 pi"),
    ],
)
def test_an_address_that_asks_for_too_much_is_refused(view, query, said):
    with pytest.raises(ConfigError, match=said):
        view.with_query(query).checked()


def test_the_numbers_are_those_of_a_run(view, tmp_path):
    config = replace(view, record={**view.record, "transient": 20, "periods": 10}).diagram(101)
    results = compute_all(config.sweep)
    path = run_sweep(config, tmp_path / "run.h5")
    with open_sweep(path) as dataset:
        for name in dataset.data_vars:
            np.testing.assert_array_equal(results[name], dataset[name].values)


def test_a_change_of_size_labels_the_axes_and_keeps_the_messages(view, page_of):
    """Axis labels change the size of a picture, so a finer picture may change it."""
    page = page_of(view)
    page._refuse("no")
    for width, label in ((30, "ω"), (400, "forcing frequency ω"), (30, "ω")):
        page._resized(page.diagram, "inner_width", 0, width)
        assert page.diagram.figure.xaxis.axis_label == label
    assert page.controls.error.text == "no"


def test_every_column_that_is_sent_is_drawn(view, page_of):
    page, drawn = page_of(view), defaultdict(set)
    for marks in page.document.select({"type": GlyphRenderer}):
        specs = (getattr(marks.glyph, name) for name in marks.glyph.dataspecs())
        drawn[marks.data_source] |= {str(getattr(spec, "field", spec)) for spec in specs}
    for source, columns in drawn.items():
        assert set(source.data) - {"orbit"} <= columns, source.name


@pytest.mark.parametrize("tab", [DIAGRAM_TAB, MAP_TAB, BASINS_TAB])
@pytest.mark.parametrize("name", ["scene", "a b"])
def test_a_saved_configuration_names_its_own_commands(view, tmp_path, tab, name):
    """Whatever is on the axes, and whether the ordinate is fitted."""
    views = [replace(view, name=name, tab=tab), replace(view, name=name, tab=tab, ylim=(-1.0, 0.0))]
    views.append(replace(views[1], ordinate="impact_v", exact=True))
    for number, seen in enumerate(views, 1):
        path = write_yaml(seen, seen.diagram(20), tmp_path)
        assert path.name == f"{name}-view-{number}.yaml"
        run, plot = (shlex.split(line[1:]) for line in path.read_text().splitlines()[1:3])
        assert run == ["vibroimpact", "run", path.name]
        assert plot[:3] == ["vibroimpact", "plot", f"{path.stem}.h5"]
        assert ("--exact" in plot) == (seen.exact and tab == DIAGRAM_TAB)


@pytest.mark.slow
@pytest.mark.parametrize("key", ["periods", "impacts"])
def test_more_than_the_memory_is_refused_with_both_figures(view, page_of, key):
    page = page_of(view)
    page.diagram.size = (4096, 400)
    page.change(lambda view: view.with_query(f"{key}=1000000"))
    two_figures = r"4,096 points takes about [\d.]+ GB of memory, and only [\d.]+ [MG]B are"
    assert re.search(two_figures, page.controls.error.text)
    assert page._steps() == []
    page.change(lambda view: view.with_query("periods=100&impacts=64"))
    assert page.controls.error.text == "" and page._steps()


@pytest.mark.slow
def test_a_logarithmic_axis_is_shown_as_one(page_of):
    config = load(
        "oscillator: {h: {start: 1e-3, stop: 1.0, num: 50, spacing: log}, R: 0.8, f: 1.0,\n"
        "             omega: {start: 0.3, stop: 6.0, num: 40, spacing: log}}\n"
        "record: {transient: 20, periods: 10}\n"
    )
    page = page_of(View.of(config))
    assert page.map.figure.yaxis.ticker.ticks == pytest.approx([0.5, 1.0, 2.0, 5.0])
    h, omega = np.geomspace(1e-3, 1.0, 16), np.geomspace(0.3, 6.0, 10)
    # An axis rounds the exact series once; geomspace has errors of its own.
    np.testing.assert_allclose(page.view.diagram(16).sweep.grid.axes["h"], h, rtol=1e-15)
    tiles = page.view.tiles(MAP_TAB, 16, 10).sweep.grid.axes
    np.testing.assert_allclose(tiles["h"], h, rtol=1e-15)
    np.testing.assert_allclose(tiles["omega"], omega, rtol=1e-15)
    figure, plane = page.diagram.figure, page.map.figure
    assert all(isinstance(s, LogScale) for s in (figure.x_scale, plane.x_scale, plane.y_scale))
    assert not isinstance(figure.y_scale, LogScale)
    page.diagram._paint(page.diagram._draw(page.view, page.view.diagram(16), 20), 0.0)
    ((left,), (width,)) = (page.diagram.source.data[name] for name in ("x", "dw"))
    step = 1e3 ** (1 / 15)
    assert (left, left + width) == pytest.approx((1e-3 / step**0.5, step**0.5))
    page.change(lambda view: view.with_axis("R"))
    assert not isinstance(figure.x_scale, LogScale)
    page.change(lambda view: view.with_axis("h"))
    assert isinstance(figure.x_scale, LogScale)
    assert page.view.xlim == pytest.approx((1e-4, 1e-2))  # around the first value


def test_pixels_are_the_shares_of_their_columns():
    values = np.array([[0.0, 0.0, 0.0, 0.9], [np.nan, np.nan, 0.5, 0.5], [2.0, 2.0, 2.0, 2.0]])
    pixels = density(values, (0.0, 1.0), 10)
    shade = {share: 1 + round((1 - np.log(share) / np.log(1e-3)) * 254) for share in (0.25, 0.75)}
    assert pixels[0, 0] == shade[0.75]
    assert pixels[9, 0] == shade[0.25]
    assert pixels[5, 1] == 255
    assert not pixels[2:5].any()


def test_the_colours_are_those_of_the_files_pictures():
    import matplotlib as mpl
    from matplotlib.colors import to_rgb

    from sweeps.plotting.pixels import _ramps
    from sweeps.plotting.style import user_style

    seen = np.array([to_rgb(colour) for colour in ramp()])
    with mpl.rc_context(user_style()):
        (in_file,) = _ramps(())
    in_files = in_file(np.linspace(0.0, 1.0, 255))[:, :3]
    np.testing.assert_allclose(seen, in_files, atol=2 / 255)


@pytest.mark.slow
def test_failed_points_are_marked_and_named():
    config = load(
        "oscillator: {h: 0.0, R: 0.8, omega: [0.5, 3.0], f: 1.0}\n"
        "method: {integrator: rk4, impact: plain, steps_per_period: 4, allow_unstable: true}\n"
        "record: {transient: 2000, periods: 10}\n"
    )
    view, columns = View.of(config), 60
    diagram = shown(view)
    picture = diagram._draw(view, view.diagram(columns), 40)
    failed = picture.results["status"] == Status.NON_FINITE
    assert 0 < failed.sum() < columns
    diagram._paint(picture, 1.0)
    source, item = diagram._strips[Status.NON_FINITE]
    np.testing.assert_array_equal(source.data["x"], picture.values[failed])
    assert item.visible
    assert diagram.legend.visible
    label = f"{Status.NON_FINITE.meaning} ({failed.sum()} of {columns})"
    assert item.label["value"] == label  # a text alone would name a column
    assert not picture.pixels[:, 1:][:, failed[1:] & failed[:-1]].any()


@pytest.mark.slow
def test_points_that_show_part_of_a_repetition_are_marked():
    """At omega = 0.2 a period has 122 impacts, of which 64 are kept; at 2.3 it has one."""
    oscillator = {"h": 0.05, "R": 0.9, "omega": [0.2, 2.3], "f": 1.0}
    record = {"transient": 20, "periods": 10}
    view = View.of(load_config({"oscillator": oscillator, "record": record}))
    diagram = shown(view)
    for ordinate, marked in (("impact_v", [0.2]), ("poincare_x", [])):
        seen = replace(view, ordinate=ordinate)
        diagram._paint(diagram._draw(seen, seen.diagram(2), 40), 1.0)
        source, item = diagram._strips[PARTIAL]
        np.testing.assert_array_equal(source.data["x"], marked)
        assert item.visible == diagram.legend.visible == bool(marked)


def test_without_bokeh_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(Refused, match=r"\.\[explore\]"):
        sweeps.explore(load_config(CONFIGS / "quickstart.yaml"))


def test_a_wrong_configuration_is_refused_as_by_run(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("oscillator: {h: 0.1, R: 2, omega: 1, f: 1}\n")
    assert refused("explore", path) == refused("run", path)
    assert "absent.yaml" in refused("explore", "absent.yaml")


@pytest.mark.parametrize("omega", [1e-3, 2.7, 3.9999999, 1e9])
def test_the_narrowest_window_has_a_value_for_every_column(view, omega):
    narrow = replace(view, xlim=(omega, omega * (1.0 + 1.001e-11)), ylim=None).checked()
    values = narrow.diagram(4096).sweep.grid.axes["omega"]
    assert len(np.unique(values)) == 4096

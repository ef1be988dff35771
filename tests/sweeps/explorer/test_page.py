"""The live picture in a real browser: every gesture, and the resulting page."""

import re
import threading
from contextlib import closing
from dataclasses import replace
from itertools import cycle
from urllib.parse import parse_qsl, urlencode

import numpy as np
import pytest

import sweeps
from sweeps import open_sweep
from sweeps.engine.executors import compute_all
from sweeps.explorer.live_diagram import density, fitted, ordinates
from sweeps.explorer.view import BASINS_TAB
from tests.helpers.browser import SCENE, Window
from tests.helpers.commands import accepted
from vibroimpact import Oscillator, one_impact_orbit

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def explorer(tmp_path_factory):
    with closing(sweeps.explore(SCENE, folder=tmp_path_factory.mktemp("explore"))) as explorer:
        yield explorer


@pytest.fixture(scope="module")
def opened(browser, explorer):
    """A window that the tests share, because a page takes two seconds to open."""
    window = Window(browser, explorer)
    yield window
    window.tab.close()


@pytest.fixture
def window(opened):
    """The shared window with the first view."""
    opened.show(opened.page.home)
    yield opened
    problems, opened.problems = opened.problems, []
    assert problems == []


@pytest.fixture
def before_chaos(window):
    """A window on the first flip alone, where there are few orbits to follow."""
    window.show(replace(window.page.home, xlim=(2.4, 2.7)))
    return window


def expected(page):
    """Return the picture of the page's view, computed independently of the page."""
    view, rows = page.view, page.diagram.snapshot.pixels.shape[0]
    config = page.diagram.configurations(view)[-1]
    values = ordinates(config, compute_all(config.sweep), view.ordinate)
    return density(values, view.ylim or fitted(values), rows)


def test_opens_with_the_diagram_of_the_configuration_and_asks_no_other_server(window, explorer):
    page = window.page
    assert page.view.xlim == (2.4, 3.5)
    columns, rows = page.diagram.size
    box = window.box()
    assert window.pixels().shape == (rows, columns) == (round(box["height"]), round(box["width"]))
    np.testing.assert_array_equal(window.pixels(), expected(page))
    assert {url.split("/")[2] for url in window.requests} == {explorer.address.split("/")[2]}
    assert window.tab.get_by_text("million periods/s").is_visible()


def test_wheel_pan_box_back_forward_and_reset(window, caplog):
    page = window.page
    home = page.view
    window.wheel(-400.0)
    window.settle(lambda: page.view.xlim != home.xlim)
    zoomed = page.view
    assert home.xlim[0] < zoomed.xlim[0] < zoomed.xlim[1] < home.xlim[1]
    np.testing.assert_array_equal(window.pixels(), expected(page))

    window.drag((0.6, 0.5), (0.4, 0.5))
    window.settle(lambda: page.view.xlim != zoomed.xlim)
    panned = page.view
    assert np.diff(panned.xlim) == pytest.approx(np.diff(zoomed.xlim))
    assert panned.xlim[0] - zoomed.xlim[0] == pytest.approx(0.2 * np.diff(zoomed.xlim)[0], rel=0.05)

    window.tool("box-zoom")
    window.drag((0.25, 0.25), (0.75, 0.75))
    window.settle(lambda: page.view.xlim != panned.xlim)
    boxed = page.view
    assert np.diff(boxed.xlim) == pytest.approx(0.5 * np.diff(panned.xlim), rel=0.02)
    assert np.diff(boxed.ylim) == pytest.approx(0.5 * np.diff(panned.ylim), rel=0.02)
    np.testing.assert_array_equal(window.pixels(), expected(page))

    window.tool("undo")
    window.settle(lambda: page.view.xlim == pytest.approx(panned.xlim))
    window.tool("redo")
    window.settle(lambda: page.view.xlim == pytest.approx(boxed.xlim))
    window.tool("reset")
    window.settle(lambda: page.view == home)
    np.testing.assert_array_equal(window.pixels(), expected(page))
    # In a notebook every refused request would be printed below the cell.
    assert [record.message for record in caplog.records if record.name == "tornado.access"] == []


def test_a_log_axis_has_round_labels_in_all_its_length(window):
    code = "{const [a] = m.below; return a.formatter.doFormat(a.ticker.ticks, {loc: 0}).join(' ')}"
    for xlim, labels in (
        ((0.1, 10.0), "0.1 0.2 0.5 1 2 5 10"),
        ((0.63, 1.57), "0.6 0.8 1 1.2 1.4 1.6"),
    ):
        window.show(replace(window.page.home, log=("omega",), xlim=xlim))
        assert window.model("diagram", code) == labels


def test_a_zoom_wins_over_a_picture_that_crosses_it_on_the_way(window):
    page = window.page
    sending, sent = threading.Event(), threading.Event()

    def paint():
        """Send a picture that fits another window before the server has read the browser's zoom."""
        sending.set()
        sent.wait(300.0)
        page.diagram._paint(replace(page.diagram.snapshot, window=(-9.0, 9.0)), 0.0)

    page.document.add_next_tick_callback(paint)
    assert sending.wait(300.0)
    window.model("diagram", "{m.y_range.setv({start: -0.5, end: -0.25})}")
    sent.set()
    window.settle(lambda: page.view.ylim == (-0.5, -0.25))
    np.testing.assert_array_equal(window.pixels(), expected(page))


def test_slider_field_abscissa_and_ordinate(window):
    page = window.page
    field = window.tab.locator("input[type=text]").nth(1)
    comma = "has a decimal comma; a number has a decimal point, no comma"
    for text, said in (("1.5", "is not allowed"), ("abc", "is not a number"), ("0,05", comma)):
        field.fill(text)
        field.press("Enter")
        window.settle(lambda text=text: text in page.controls.error.text)
        refusal = f"R = {text} {said}; expected: a number from 0 to 1"
        assert page.controls.error.text.startswith(refusal)
        assert "sweep" not in page.controls.error.text
        assert page.view.values["R"] == 0.8
        assert page.controls.fields["R"].value == text
    window.settle(window.tab.get_by_text("a number from 0 to 1").is_visible)
    field.fill("0.8")
    field.press("Enter")
    window.settle(lambda: page.controls.error.text == "")
    window.model("R slider", "{m.value = 0.6}")
    window.settle(lambda: page.view.values["R"] == 0.6)
    np.testing.assert_array_equal(window.pixels(), expected(page))
    assert window.model("R", "{return m.value}") == "0.6"
    field.fill("0.7")
    field.press("Enter")
    window.settle(lambda: page.view.values["R"] == 0.7)
    selects = window.tab.locator("select:visible")
    selects.nth(0).select_option(label="speed before the impact")
    window.settle(lambda: page.view.ordinate == "impact_v")
    selects.nth(1).select_option(label="R: coefficient of restitution")
    window.settle(lambda: page.view.axis == "R" and page.view.xlim == (0.0, 1.0))
    np.testing.assert_array_equal(window.pixels(), expected(page))


def test_a_click_shows_the_motion_and_the_mark_can_be_dragged(window):
    page = window.page
    window.click(0.1, 0.5)
    window.settle(window.shows_motion)
    assert "1/1" in page.motion.text.text
    value = page.view.values["omega"]
    assert value == pytest.approx(2.51, abs=0.01)
    osc = Oscillator(h=0.05, R=0.8, omega=value, f=1.0)
    orbit = one_impact_orbit(osc)
    assert f"{orbit.multipliers[0].real:.4g}" in page.motion.text.text
    assert "stop, x = σ = 0" in page.motion.text.text
    window.settle(lambda: window.model("motion: impacts", "{return m.data.v.length}") == 4)
    impacts = window.model("motion: impacts", "{return [...m.data.v]}")
    assert impacts == pytest.approx([orbit.v] * 4)
    assert max(window.model("motion", "{return [...m.data.x]}")) <= 1e-12
    window.drag((0.1, 0.5), (0.5, 0.5))
    window.settle(lambda: page.view.values["omega"] == pytest.approx(2.95, abs=0.02))
    window.settle(lambda: "Lyapunov exponents 0." in page.motion.text.text)
    assert page.view.xlim == (2.4, 3.5), "the figure was panned instead"


def test_exact_branches_lie_over_the_points_come_and_go(before_chaos):
    window, page = before_chaos, before_chaos.page
    button, seen = window.tab.get_by_text("exact branches"), "{return m.visible}"
    button.click()
    window.settle(lambda: window.model("flip marks", seen))
    shown = window.model("flip", "{return [...m.data.x]}")
    assert min(abs(np.array(shown) - 2.65888454668484)) < 1e-9
    stable = window.model("exact orbits, stable", "{return m.data.x.map((x) => [...x])}")
    assert min(min(x) for x in stable) == pytest.approx(2.4)
    window.model("R slider", "{m.value = 0.6}")
    window.settle(lambda: page.view.values["R"] == 0.6)
    window.settle(lambda: window.model("flip", "{return Math.min(...m.data.x)}") != min(shown))
    window.settle(lambda: window.model("flip marks", seen))
    assert min(abs(np.array(window.model("flip", "{return [...m.data.x]}")) - 2.65888)) > 1e-4
    for on in (False, True):
        button.click()
        window.settle(lambda on=on: window.model("flip marks", seen) is on)


def test_a_diagram_of_earlier_values_is_dimmed_and_says_what_it_awaits(before_chaos, monkeypatch):
    """The first exact branches are not cancelled by a new view, because they compile."""
    window, page, compiled = before_chaos, before_chaos.page, threading.Event()
    page.worker._done.pop("exact branches", None)
    find = page.branches._find
    monkeypatch.setattr(page.branches, "_find", lambda *of: compiled.wait(300.0) and find(*of))
    shown = "{return m.visible ? m.text : ''}"
    window.tab.get_by_text("exact branches").click()
    window.tab.get_by_text("computing: exact branches").wait_for()
    assert window.model("diagram waits", shown) == ""  # the diagram is that of the fields
    window.model("R slider", "{m.value = 0.6}")
    window.tab.get_by_text("computing: exact branches, compiled at the first use").wait_for()
    waits = "Bokeh.documents[0].get_model_by_name('diagram waits')"
    window.tab.wait_for_function(f"{waits}.visible && {waits}.text.includes('first use')")
    text = window.model("diagram waits", shown)
    assert text.startswith("this is the previous picture;\nwaiting for exact branches,")
    compiled.set()
    window.settle(lambda: page.view.values["R"] == 0.6)
    window.settle(lambda: window.model("diagram waits", shown) == "")
    np.testing.assert_array_equal(window.pixels(), expected(page))


def test_the_address_holds_the_view(window):
    page = window.page
    window.wheel(-300.0)
    window.settle(lambda: page.view.ylim is not None)
    window.model("R slider", "{m.value = 0.65}")
    window.settle(lambda: page.view.values["R"] == 0.65)
    here = "location.search"
    window.settle(lambda: window.tab.evaluate(here).startswith("?" + page.view.query()))
    seen, address, pixels = page.view, window.tab.evaluate("location.href"), window.pixels()
    assert "R=0.65" in address
    window.tool("reset")
    window.settle(lambda: page.view.ylim is None)
    window.open(address)
    assert window.page is not page
    window.settle(lambda: window.page.view == seen)
    np.testing.assert_array_equal(window.pixels(), pixels)


def test_basins_at_the_mark_and_a_start_out_of_them(window):
    page = window.page
    for name, value in (("h", 0.0), ("omega", 1.3)):  # two motions coexist
        window.model(f"{name} slider", f"{{m.value = {value}}}")
        window.settle(lambda name=name, value=value: page.view.values[name] == value)
    window.model("transient", "{m.value = '100'}")
    window.settle(lambda: page.view.record["transient"] == 100)
    window.tab.get_by_text("basins", exact=True).click()
    window.tiles("basins")
    orbit = one_impact_orbit(Oscillator(h=0.0, R=0.8, omega=1.3, f=1.0))
    assert f"1/1: {orbit.v:.4g};" in page.basins.legend.text
    assert "2/3: 0.703, 1.114, 2.254;" in page.basins.legend.text
    radii = re.findall(r"; disc (?:&gt;= )?([\d.]+)<", page.basins.legend.text)
    radii = np.array(radii, float)
    np.testing.assert_allclose(page.basins.discs.data["width"], 2.0 * radii, rtol=5e-3)
    assert len(radii) == 2 and min(radii) > 0.1
    window.click(0.4, 0.6, "basins")
    window.settle(window.shows_motion)
    assert page.view.tab == BASINS_TAB
    assert page.view.values["x0"] == pytest.approx(-1.8, abs=0.05)


def test_a_map_of_classes_gives_its_row_or_its_column_to_the_diagram(window):
    page = window.page
    window.show(replace(page.home, record={**page.home.record, "transient": 20}))
    window.tab.get_by_text("map of classes").click()
    tiles, box = window.tiles("map"), window.box("map")
    assert window.tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert tiles.pixels.shape == (round(box["height"]), round(box["width"]))
    shares = re.findall(r">■</span> (\d+/\d+) \(([\d.]+) %", page.map.legend.text)
    computed = {name: 100.0 * share for name, _, share in tiles.kinds if name[0].isdigit()}
    assert {name: float(share) for name, share in shares} == pytest.approx(computed, rel=5e-3)
    assert len(computed) > 6
    window.click(0.5, 0.25, "map")
    window.settle(lambda: page.view.tab == 0)
    assert page.view.values["R"] == pytest.approx(0.75, abs=0.01)
    assert page.view.axis == "omega"
    assert page.view.marked
    window.tab.get_by_text("map of classes").click()
    window.tab.get_by_text("column", exact=True).click()
    window.tiles("map")
    window.click(0.25, 0.5, "map")
    window.settle(lambda: page.view.tab == 0)
    assert (page.view.axis, page.view.across) == ("R", "omega")
    assert page.view.values["omega"] == pytest.approx(2.4 + 1.1 / 4, abs=0.01)
    window.tab.set_viewport_size({"width": 600, "height": 700})
    window.tab.get_by_text("map of classes").click()
    code = "{const {el} = Bokeh.index.find_one(m); return el.clientHeight - el.scrollHeight}"
    window.settle(lambda: window.model("map legend", code) == 0)  # all of it is visible


def test_what_is_saved_runs_to_the_same_numbers(window, tmp_path):
    page = window.page
    window.wheel(-300.0)
    window.settle(lambda: page.view.ylim is not None)
    window.tab.get_by_text("save as YAML").dblclick()
    window.settle(lambda: "saved" in page.controls.saved.text)
    (path,) = page.folder.glob("scene-view-*.yaml")
    accepted("run", path, "-o", tmp_path / "again.h5", "--quiet")
    path.unlink()
    shown = page.diagram.snapshot.results
    with open_sweep(tmp_path / "again.h5") as dataset:
        assert dataset.sizes["section"] == page.view.record["periods"] == 4
        assert dataset.sizes["impact"] == page.view.record["impacts"] and "period" in dataset
        for name in ("poincare_x", "poincare_v"):  # the page has recorded on
            np.testing.assert_array_equal(dataset[name].values, shown[name][:, :4])


# Untrusted texts

ODD = "<img src=x onerror='window.ran = 1'>"
MARKUP = (
    '<img src=x onerror="window.ran = 1">',
    "<svg onload='window.ran = 1'>",
    "<script>window.ran = 1</script>",
    '"><iframe srcdoc="<script>parent.ran = 1</script>">',
    "&lt;b&gt; <b>$$x$$",
)


def shown(window, name):
    """Return the visible text of a message, and the number of its elements."""
    js = "{let e = Bokeh.index.find_one(m).markup_el; return [e.textContent, e.children.length]}"
    return window.model(name, js)


def test_markup_in_files_addresses_and_fields_is_shown_as_text(window):
    page, controls = window.page, window.page.controls
    window.show(replace(page.home, name=ODD))
    window.tab.get_by_text("save as YAML").click()
    window.settle(lambda: ODD in controls.error.text)  # no file has such a name on every system
    window.settle(lambda: shown(window, "error") == [controls.error.text, 0])
    assert not list(page.folder.glob("*.yaml.*")) and not list(page.folder.glob("*img*"))
    for (key, _), markup in zip(parse_qsl(page.view.query())[::3], cycle(MARKUP), strict=False):
        window.model("address", f"{{m.value = {urlencode({key: markup})!r}}}")  # which it reads
        window.settle(lambda markup=markup: markup in controls.error.text)
        window.settle(lambda: shown(window, "error") == [controls.error.text, 0])
    assert window.tab.evaluate("window.ran") is None


def test_a_script_that_gets_into_the_page_is_not_run(window):
    window.tab.evaluate(
        "window.refused = []; document.addEventListener('securitypolicyviolation',"
        " (event) => window.refused.push(event.target.nodeName))"
    )
    code = "(text) => document.body.append(document.createRange().createContextualFragment(text))"
    for markup in MARKUP:
        window.tab.evaluate(code, markup)
    # Some versions of Chromium do not report an empty picture as loaded.
    window.tab.evaluate("document.querySelector('body > svg').dispatchEvent(new Event('load'))")
    # An event tells of each but the frame, which has a document of its own.
    kinds = "['IMG', 'svg', 'SCRIPT'].every((name) => window.refused.includes(name))"
    window.settle(lambda: window.tab.evaluate(f"window.ran || {kinds}"))
    assert window.tab.evaluate("window.ran") is None

"""The live picture in a real browser: small pages, keys alone, the mass that moves, and a rig."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import sweeps
from sweeps import load_config
from tests.helpers.browser import SCENE, Window
from tests.helpers.places import CONFIGS
from tests.sweeps.explorer.test_page import ODD, expected

pytestmark = pytest.mark.slow
#: The element that has the focus: its role or tag, its name, and whether it is open or pressed.
FOCUS = """(() => {
  let e = document.activeElement;
  while (e.shadowRoot?.activeElement) e = e.shadowRoot.activeElement;
  const name = e.ariaLabel || e.title || e.labels?.[0]?.textContent || e.textContent;
  return [e.role || e.tagName, name.trim(), e.ariaSelected ?? e.ariaPressed];
})()"""

#: Lets the Tab key begin at the start of the page.
START = "document.body.tabIndex = -1; document.body.focus(); document.body.blur()"


@pytest.fixture(scope="module")
def phone(browser):
    """A window as wide as a phone."""
    with closing(sweeps.explore(SCENE)) as explorer:
        window = Window(browser, explorer, size=(390, 844))
        yield window
        assert window.problems == []


@pytest.fixture
def window(phone):
    """The window with the first view, from its top."""
    phone.show(phone.page.home)
    phone.tab.emulate_media(reduced_motion="no-preference")
    phone.tab.evaluate("scrollTo(0, 0)")
    return phone


def show_motion(window):
    """Click at the motion with one impact per period."""
    window.click(0.1, 0.5)
    window.settle(window.shows_motion)


def test_the_plot_has_the_width_of_a_phone_and_the_controls_are_below(window):
    fits = "document.documentElement.scrollWidth <= innerWidth"
    assert window.box()["width"] > 330
    show_motion(window)
    assert window.tab.evaluate(fits)
    time_history = window.box("motion: x over t")
    assert time_history["width"] > 300
    assert time_history["y"] > window.box()["y"] + window.box()["height"]
    button = window.tab.get_by_text("exact branches").bounding_box()
    phase_plane = window.box("motion: v over x")
    assert button["y"] > phase_plane["y"] + phase_plane["height"] > time_history["y"]
    for text, name in (("map of classes", "map"), ("basins", "basins")):
        window.tab.get_by_text(text, exact=True).first.click()
        window.settle(lambda name=name: window.box(name)["width"] > 330)
        assert window.tab.evaluate(fits)


def test_the_legend_of_the_basins_is_above_the_motion_on_a_low_and_narrow_page(window):
    window.tab.set_viewport_size({"width": 690, "height": 400})
    window.settle(lambda: window.box()["width"] > 450)
    code = "{const box = Bokeh.index.find_one(m)?.el.getBoundingClientRect();"
    code += "return box?.height > 0 && [box.top, box.bottom]}"

    def is_below_the_legend():
        text, legend = (window.model(name, code) for name in ("motion: text", "basins legend"))
        return text and legend and legend[1] <= text[0] and text[1] < 400.0

    show_motion(window)
    window.tab.get_by_text("basins", exact=True).click()
    window.settle(is_below_the_legend)


def test_the_tab_key_comes_to_tabs_plot_and_controls_and_each_says_what_it_is(window):
    key, stops = window.tab.keyboard.press, []
    window.tab.evaluate(START)
    key("Tab")
    while (stop := window.tab.evaluate(FOCUS))[0] != "BODY":
        stops.append(stop)
        key("Tab")
    names = ("diagram", "true"), ("map of classes", "false"), ("basins", "false")
    assert stops[:3] == [["tab", *name] for name in names]
    assert stops[3][:2] == ["application", "diagram"]
    kinds = [kind for kind, *_ in stops]
    assert set(kinds[4 : kinds.index("SELECT")]) == {"button"}  # the tools of the plot
    names = [name for _, name, _ in stops]
    assert "" not in names
    for part in ("R: coefficient of restitution", "ω: forcing frequency"):
        both = [kind for kind, name, _ in stops if name.startswith(part)]
        assert both == ["INPUT", "slider"]
    assert names[-2:] == ["exact branches", "save as YAML"]


def test_keys_alone_open_a_tab_move_a_value_and_show_a_motion(window):
    key, page = window.tab.keyboard.press, window.page
    window.tab.evaluate(START)
    for _ in range(3):
        key("Tab")
    key("Enter")
    window.settle(lambda: page.view.tab == 2)
    key("Shift+Tab")
    key("Shift+Tab")
    key(" ")
    window.settle(lambda: page.view.tab == 0)
    for _ in range(3):
        key("Tab")
    assert window.tab.evaluate(FOCUS)[1] == "diagram"
    key("Enter")
    window.settle(window.shows_motion)
    assert page.view.values == page.home.values
    while not window.tab.evaluate(FOCUS)[1].startswith("ω: forcing") or (
        window.tab.evaluate(FOCUS)[0] != "slider"
    ):
        key("Tab")
    key("ArrowRight")
    window.settle(lambda: page.view.values["omega"] > 2.4 and window.shows_motion())
    key("Escape")
    window.settle(lambda: not page.view.marked)


def test_keys_move_and_zoom_the_window_and_close_the_motion(window):
    page, key = window.page, window.tab.keyboard.press
    home = page.view
    show_motion(window)
    key("Escape")
    window.settle(lambda: not page.view.marked)
    window.settle(window.tab.get_by_text("close (Esc)").first.is_hidden)
    low, high = page.diagram.snapshot.window
    key("+")
    window.settle(lambda: page.view.xlim == pytest.approx((2.675, 3.225)))
    middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
    assert page.view.ylim == pytest.approx((middle - quarter, middle + quarter))
    key("ArrowRight")
    window.settle(lambda: page.view.xlim == pytest.approx((2.73, 3.28)))
    key("Home")
    window.settle(lambda: page.view == replace(home, values=page.view.values))


def mass(window):
    """Return time, displacement and velocity of the mass."""
    return window.model("mass", "{return [m.data.t[0], m.data.x[0], m.data.v[0]]}")


def test_a_button_moves_the_mass_along_its_motion_and_stops_it(window):
    show_motion(window)
    line = window.model("motion", "{return [[...m.data.t], [...m.data.x]]}")
    button = window.tab.get_by_text("move the mass")
    start = mass(window)
    assert start[0] == 0.0
    button.click()
    seen = [start]
    while len(seen) < 5:
        window.tab.wait_for_timeout(50)
        if (now := mass(window)) != seen[-1]:
            seen.append(now)
    for time, x, _ in seen:
        assert x == pytest.approx(np.interp(time, *line), abs=1e-9)
    button.click()
    window.settle(lambda: not window.model("moving", "{return m.active}"))
    frame = "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"
    window.tab.evaluate(frame)
    at_rest = mass(window)
    for _ in range(5):
        window.tab.evaluate(frame)
    assert mass(window) == at_rest


def test_the_mass_stands_still_where_the_browser_asks_for_reduced_motion(window):
    window.tab.emulate_media(reduced_motion="reduce")
    show_motion(window)
    start = mass(window)
    window.tab.get_by_text("move the mass").click()
    for _ in range(10):
        window.tab.wait_for_timeout(30)
        assert mass(window) == start
    assert not window.model("moving", "{return m.active}")


def test_a_rig_over_a_logarithmic_axis_and_the_end_of_the_page(window, tmp_path):
    """At the sections, the mass of this rig is at most 0.2 mm away. The last test of the window."""
    changes = ["record={transient: 60, periods: 4}", "rig.frequency.spacing=log"]
    config = load_config(CONFIGS / "shaker.yaml", [*changes, f"name={ODD}"])
    with closing(sweeps.explore(config, folder=tmp_path)) as window.explorer:
        window.open(window.explorer.address)
        page, y = window.page, "m.left[0]"
        assert window.tab.title() == f"{ODD}: vibroimpact"
        np.testing.assert_array_equal(window.pixels(), expected(page))
        window.click(0.5, 0.5)
        window.settle(lambda: page.motion.text.text != "")
        assert page.view.values["omega"] == pytest.approx(480**0.5, rel=0.01)
        window.wheel(-300.0)
        window.settle(lambda: page.view.xlim[0] > 17.0)
        assert np.prod(page.view.xlim) == pytest.approx(480.0, rel=0.02)
        window.show(page.home)
        assert window.model("diagram", "{return m.title.text}").endswith("x [mm]")
        write = f"{{return {y}.formatter.doFormat([-5e-5, 0, 5e-5, 1e-4], {{loc: 0}})}}"
        assert window.model("diagram", write) == ["\u22120.05", "0.00", "0.05", "0.10"]
        window.show(replace(page.view, ylim=(0.0, 2.0)))
        assert window.model("diagram", "{return m.title.text}").endswith("x [m]")
        assert window.model("diagram", write) != ["\u22120.05", "0.00", "0.05", "0.10"]
        assert window.tab.evaluate("window.ran") is None
        ended = window.tab.get_by_text("vibroimpact explore has ended")
        assert not ended.is_visible()
        window.explorer.close()
        ended.wait_for()

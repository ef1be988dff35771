"""The live picture of a rig, in the names and SI units of the rig."""

import re
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document

from sweeps import ConfigError, load_config
from sweeps.explorer.live_maps import Filling
from sweeps.explorer.live_motion import motion_at
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.view import MAP_TAB, View, write_yaml
from sweeps.plotting.style import STABLE
from tests.helpers.places import CONFIGS
from vibroimpact.oscillator import PARAMETERS, Oscillator

pytestmark = pytest.mark.slow


@pytest.fixture
def rig(tmp_path):
    """The page of a rig on a shaker, swept from 15 to 32 Hz."""
    page = LivePage(Document(), View.of(load_config(CONFIGS / "shaker.yaml")), tmp_path)
    yield page
    page.worker.shutdown()


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


def test_a_picture_of_a_rig_is_drawn_in_si_units_from_the_numbers_of_its_run(rig, tmp_path):
    view = replace(rig.view, record={**rig.view.record, "transient": 20, "periods": 10})
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


def test_exact_branches_of_a_rig_are_at_their_frequencies(rig):
    """The free oscillation grazes where its amplitude in closed form is the gap."""
    p2, h, a, gap = 8000.0 / 0.5, 4.0 / (2 * 0.5), 5e-5, 3e-4
    # a^2 w^4 = gap^2 ((p^2 - w^2)^2 + 4 h^2 w^2), a quadratic in w^2
    squares = np.roots([gap**2 - a**2, gap**2 * (4 * h**2 - 2 * p2), gap**2 * p2**2])
    parts = rig.branches._find(rig.view, rig.view.diagram(40))
    for graze in np.sqrt(squares) / (2 * np.pi):
        assert min(abs(np.array(parts["graze"]["x"]) - graze)) < 1e-6 * graze
    assert max(x.max() for x in parts[STABLE]["x"]) == pytest.approx(32.0)


def shown_beside_fields(page):
    """Return the texts beside the fields of the parameters."""
    return [page.controls.fields[name].title for name in PARAMETERS]


def test_the_fields_of_a_rig_have_the_units_of_their_numbers(rig, tmp_path):
    of_oscillator = ["c [N s/m]", "R", "ν [Hz]", "F [N]", "k [N/m]", "σ [m]", "a [m]"]
    assert shown_beside_fields(rig) == [*of_oscillator, "x₀ [m]", "v₀ [m/s]", "ω t₀"]
    page = LivePage(Document(), View.of(load_config(CONFIGS / "quickstart.yaml")), tmp_path)
    page.worker.shutdown()
    assert shown_beside_fields(page)[:3] == ["h", "R", "ω"]


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


def test_the_text_on_a_motion_of_a_rig_has_units(rig):
    rig.motion._paint(rig.view, motion_at(rig.view), 0.0)
    assert "ν = 15 Hz: settled on 1/0; " in rig.motion.text.text
    assert rig.motion.text.text.endswith("stop, x = σ = 0.3 mm")

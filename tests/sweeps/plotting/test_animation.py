"""Motions in time and in the phase plane, how long and how fine, and animations of them."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from sweeps import Refused, plotting
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import Page, animate, animation, plot
from tests.helpers.commands import accepted, refused
from tests.helpers.sweep_files import swept
from vibroimpact import Oscillator, simulate

#: A motion 1/1, chaos, a motion 2/1 and one that rests in every period.
SWEEP = """
oscillator: {h: 0.05, R: 0.8, omega: [2.6, 2.8, 3.45, 0.3], f: 1.0}
record: {transient: 300, periods: 40}
"""
PERIODIC, CHAOTIC, LONGER, RESTING = 2.6, 2.8, 3.45, 0.3


def film_of(dataset, omega, **options):
    return animation._film(dataset, at={"omega": omega}, **options)


def shown(film, frame):
    """Return the upper side of the mass, and the ends of x over t and of v over x."""
    film.show_frame(frame)
    (mass,) = (patch for patch in film.mass.patches if patch in film.moving)
    curve, orbit = film.over_time.lines[0], film.phase_plane.lines[0]
    return mass.get_y() + mass.get_height(), curve.get_xydata()[-1], orbit.get_xydata()[-1]


def motion_of(dataset, omega, periods):
    """Return the motion that follows the last section, in fine steps."""
    at = dataset.sel(omega=omega)
    x, v = float(at["poincare_x"][-1]), float(at["poincare_v"][-1])
    oscillator = Oscillator(h=0.05, R=0.8, omega=omega, f=1.0)
    return simulate(oscillator, periods, steps_per_period=1000, x0=x, v0=v)


@pytest.mark.parametrize("omega", [CHAOTIC, RESTING])
def test_the_mass_moves_as_the_motion_does_and_touches_the_stop_at_impacts(dataset, omega):
    film, motion = film_of(dataset, omega, periods=3, fps=7), motion_of(dataset, omega, 3)
    times, size, fps = film.times, np.ptp(motion.x), 7
    assert len(times) == 1 + 6 * fps and (np.diff(times) > 0.0).all()
    step = 3 * 2.0 * np.pi / omega / (6 * fps)
    assert np.abs(times - step * np.arange(len(times))).max() <= 0.5 * step * (1.0 + 1e-9)
    for frame in range(0, len(times), 5):
        top, (t, x), (across, v) = shown(film, frame)
        assert t == times[frame] and x == across and abs(top - x) < 1e-12 * size
        assert x == pytest.approx(np.interp(t, motion.t, motion.x), abs=4e-4 * size)
        if np.abs(motion.impact_t - t).min() > 0.1 * step:
            assert v == pytest.approx(np.interp(t, motion.t, motion.v), abs=2e-3 * np.ptp(motion.v))
    for impact in motion.impact_t:  # the nearest frame shows it, or another one beside it
        nearest = np.abs(times - impact).argmin()
        others = np.abs(motion.impact_t - times[nearest]).min()
        assert min(abs(times[nearest] - impact), others) < 1e-9
        assert abs(shown(film, nearest)[0]) < 1e-12 * size


@pytest.mark.parametrize("omega", [LONGER, RESTING, CHAOTIC])
def test_a_motion_is_shown_until_it_closes(dataset, omega):
    film, periods = film_of(dataset, omega, fps=5), 10 if omega == CHAOTIC else 4
    assert film.times[-1] == pytest.approx(periods * 2.0 * np.pi / omega)
    begin, end = (np.array(shown(film, frame)[2]) for frame in (0, -1))
    if omega != CHAOTIC:
        np.testing.assert_allclose(begin, end, atol=1e-6)


def painted(film, frame):
    film.show_frame(frame)
    FigureCanvasAgg.draw(film.canvas)
    return np.array(film.canvas.buffer_rgba())[..., :3].astype(int)


@pytest.mark.slow
def test_a_gif_has_the_frames_of_the_film(path, dataset, with_layout):
    """Colours differ by less than can be seen, and what does not move never changes."""
    words = "--kind", "trajectory", "--at", "omega=2.81", "--fps", "2", "--periods", "2"
    assert accepted("plot", path, *words, "-o", "a.gif").endswith("a.gif\n")
    film = film_of(dataset, CHAOTIC, periods=2, fps=2)
    pixels = [painted(film, frame) for frame in range(len(film.times))]
    still = np.all([one == pixels[0] for one in pixels], axis=(0, 3))
    assert 0.5 < still.mean() < 0.99
    with Image.open("a.gif") as image:
        assert image.n_frames == len(film.times) == 9 and image.info["loop"] == 0
        assert b"configuration:" in image.info["comment"]
        seen, lasts = [], 0
        for frame in range(9):
            image.seek(frame)
            lasts += image.info["duration"]
            seen.append(np.array(image.convert("RGB")).astype(int))
    for one, painting in zip(seen, pixels, strict=True):
        assert (one[painting.min(axis=2) == 255] == 255).all()
        assert np.abs(one - painting).max() < 32
        np.testing.assert_array_equal(one[still], seen[0][still])
    assert abs(lasts - 1000.0 * len(pixels) / 2) <= 5.0


@pytest.mark.parametrize("page", [Page(grey=True), Page(width=2.6), Page(ylim=(-0.5, 0.1))])
def test_each_frame_is_painted_as_the_whole_picture_would_be(dataset, page, with_layout):
    film = film_of(dataset, PERIODIC, periods=1, fps=5, page=page)
    first = painted(film, 4)
    np.testing.assert_array_equal(painted(film, 4), first)
    boxes = [panel.get_position().bounds for panel in film.axes]
    limits = [(panel.get_xlim(), panel.get_ylim()) for panel in film.axes]
    assert film.over_time.xaxis.label.get_window_extent().x1 <= film.bbox.x1
    painted(film, 9)
    assert boxes == [panel.get_position().bounds for panel in film.axes]
    assert limits == [(panel.get_xlim(), panel.get_ylim()) for panel in film.axes]
    if page.grey:
        red, green, blue = np.moveaxis(first, -1, 0)
        assert (red == green).all() and (green == blue).all()
    if page.ylim:
        assert film.mass.get_ylim() == film.over_time.get_ylim() == page.ylim


def test_an_mp4_is_made_by_ffmpeg(dataset, folder, monkeypatch):
    """Its frames are those that it reads; here it only counts their bytes."""
    program = folder / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\necho "$@" > called\nwc -c > "$last"\n')
    program.chmod(0o755)
    monkeypatch.setitem(animation.mpl.rcParams, "animation.ffmpeg_path", str(program))
    plot(dataset, "a.mp4", at={"omega": PERIODIC}, fps=5, periods=1)
    words = Path("called").read_text().split()
    assert "5" in words and "h264" in words
    width, height = map(int, words[words.index("-s") + 1].split("x"))
    assert int(Path("a.mp4").read_text()) == 11 * width * height * 4
    program.write_text("#!/bin/sh\nexit 1\n")
    with pytest.raises(Exception, match="ffmpeg cannot make the animation") as error:
        plot(dataset, "b.mp4", at={"omega": PERIODIC}, fps=5, periods=1)
    assert type(error.value).__name__ == "Failed" and not Path("b.mp4").exists()


def test_an_interrupt_that_ends_ffmpeg_too_is_no_failure_of_it(dataset, folder, monkeypatch):
    """A terminal sends Ctrl-C to both."""
    program = folder / "ffmpeg"
    program.write_text("#!/bin/sh\nexit 255\n")
    program.chmod(0o755)
    monkeypatch.setitem(animation.mpl.rcParams, "animation.ffmpeg_path", str(program))

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(animation.FFMpegWriter, "grab_frame", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plot(dataset, "a.mp4", at={"omega": PERIODIC}, fps=5, periods=1)
    assert [path.name for path in folder.iterdir()] == ["ffmpeg"]


WRONG = [
    (("-o", "a.gif", "--fps", "0"), "--fps 0 is not allowed; expected: an integer from 1 to 50"),
    (("-o", "a.gif", "--periods", "101"), "periods = 101 is not allowed in an animation; expected"),
    (("-o", "a.gfi"), "a.gfi must end in one of .png, .svg, .pdf, .eps, .tiff, .tif, .gif"),
    (("-o", "a.mp4"), "a.mp4 needs the program ffmpeg, which is not found; a .gif needs none"),
    (("-o", "a.png", "--fps", "9"), "fps is only for an output that ends in .gif or .mp4"),
    (("-o", "a.gif", "--dpi", "4000"), "pixels are too many; expected: at most 500,000,000"),
    (("-o", "a.gif", "--color", "period"), "a.gif is not allowed for several motions; expected"),
    (("-o", "a.gif", "--at", "omega=2.6,2.8"), "a.gif is not allowed for several motions"),
    (("-o", "a.gif", "--kind", "map"), "a.gif is not allowed for the picture map; expected: the"),
    (("-o", "a.gif", "--kind", "bifurcation", "--exact"), "for the picture bifurcation; expected"),
    (("-o", "a.gif", "--kind", "trajektory"), "'trajektory' (did you mean trajectory?)"),
]


@pytest.mark.parametrize(("words", "message"), WRONG)
def test_what_is_no_animation_is_refused_at_once(path, folder, words, message, monkeypatch):
    monkeypatch.setenv("PATH", str(folder))
    for name in ("opened.coordinates.continue_motion", "bifurcation.branch_set.BranchSet"):
        monkeypatch.setattr(f"sweeps.{name}", lambda *_, **__: pytest.fail("it is computed"))
    kind = () if "--kind" in words else ("--kind", "trajectory")
    assert message in refused("plot", path, *kind, *words)
    assert list(folder.iterdir()) == []


def test_a_notebook_gets_all_frames_whatever_the_limit_of_matplotlib(dataset):
    with animation.mpl.rc_context({"animation.embed_limit": 0.01}):
        player = animate(dataset, at={"omega": PERIODIC}, periods=1, fps=1, page=Page(dpi=60))
        assert player.to_jshtml().count("data:image/png") == 3
    with pytest.raises(Refused, match="fps = 51 is not allowed; expected: an integer from 1 to 50"):
        animate(dataset, fps=51)


@pytest.mark.slow
def test_a_motion_is_shown_over_two_repetitions_with_its_class():
    """A 3/2 motion over six periods; where no class is known, over four."""
    oscillator, record = "{h: 0.05, R: 0.5, omega: 5.18, f: 1.0}", "{transient: 300, periods: 40}"
    classed = swept(f"oscillator: {oscillator}\nrecord: {record}\n")
    unclassed = classed.drop_vars(["period", "period_impacts"])
    for data, shown, periods in ((classed, "class 3/2, $t_0=", 6), (unclassed, "$t_0=", 4)):
        figure = plotting.trajectory(data)
        t = figure.axes[0].lines[0].get_xdata()
        assert t[-1] == pytest.approx(periods * 2.0 * np.pi / 5.18)
        assert f", {shown}" in figure.get_suptitle()


LONG = """
oscillator: {h: 0.05, R: 0.8, omega: 2.3, f: 1.0}
record: {transient: 0, periods: 2000, trajectory: {every: 7}}
"""


@pytest.mark.slow
def test_a_long_motion_is_drawn_by_whole_periods_from_all_of_it():
    """No more samples than pixels, however long the record; here one period of two."""
    dataset = swept(LONG)
    figures = [plotting.trajectory(dataset, periods=periods) for periods in (None, 2000)]
    sampling = 7 / OpenedSweep(dataset).config.method.steps_per_period
    for figure, step in zip(figures, (sampling, 0.0), strict=True):  # as recorded, and computed
        t, x = figure.axes[0].lines[0].get_xdata(), figure.axes[0].lines[0].get_ydata()
        assert len(t) < 1000 * 250
        gaps = np.flatnonzero(np.isnan(t))
        periods = np.split(t / (2.0 * np.pi / 2.3), gaps)
        begins = np.array([piece[0 if i == 0 else 1] for i, piece in enumerate(periods[:1000])])
        ends = np.array([piece[-1] for piece in periods[:1000]])
        np.testing.assert_allclose(begins, 2 * np.arange(1000), atol=step + 1e-6)
        assert (ends - begins > 1.0 - step - 1e-6).all()
        assert np.nanmax(x) < 1e-9 and np.nanmin(x) < -0.3
        assert "1,000 of 2,000 periods" in figure.get_suptitle().replace("\n", " ")

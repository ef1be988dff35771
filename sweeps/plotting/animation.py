"""Animates a motion: the mass at its stop, beside it growing curves; GIF or MP4."""

from __future__ import annotations

import math
import subprocess
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation
from matplotlib.artist import Artist
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from sweeps.errors import Failed, Refused
from sweeps.opened.coordinates import periods_shown
from sweeps.opened.doors import AnySweep
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.motion_pictures import NARROW, trajectory
from sweeps.plotting.page import FPS, PAGE, Page, styled
from sweeps.plotting.style import data_colour, ground, ink
from sweeps.store.replacing import writing

#: Most forcing periods, and their number where it is not known after how many a motion repeats.
_MOST_PERIODS, _UNKNOWN = 100, 10
#: Longest and shortest time for a forcing period, and the time for all if these allow it [s].
_SLOWEST, _FASTEST, _IN_ALL = 2.0, 0.6, 20.0
#: Pixels per inch unless the page has its own, and most pixels of all frames of a file.
_DPI, _MOST_PIXELS = 130, 500_000_000
#: Heights of the mass, of the shortest spring and of the stop, as shares of the range of x.
_MASS, _SHORTEST, _STOP = 0.16, 0.16, 0.06
#: Abscissas of the corners of the spring.
_SPRING = (0.5, 0.5, *4 * (0.35, 0.65), 0.5, 0.5)


def animate(
    sweep: AnySweep,
    *,
    at: Selection | None = None,
    periods: int | None = None,
    fps: int = FPS,
    page: Page = PAGE,
) -> FuncAnimation:
    """Animate the motion of one point: the mass at its stop, x over t and the phase plane.

    The mass is beside x over t, at the height of x; both diagrams grow with the motion. The frame
    nearest to an impact shows the instant of the impact. A forcing period takes 2 s, and less in a
    motion of more than 10 periods.

    Parameters
    ----------
    sweep : Dataset or str or Path
        From `sweeps.open_sweep`, or the path of its file.
    at : mapping of str to float, optional
        Values of the swept axes, as for `sweeps.plotting.trajectory`.
    periods : int, optional
        Number of forcing periods after the last state at the section, at most 100. By default two
        repetitions of a motion that is known to repeat, but at least four periods; 10 of another.
    fps : int
        Frames per second, from 1 to 50.
    page : Page, optional
        Size, title, limits and look.

    Returns
    -------
    FuncAnimation
        For a notebook, as ``IPython.display.HTML(animation.to_jshtml())``; `sweeps.plotting.plot`
        writes files.

    Raises
    ------
    Refused
        If the motion cannot be computed.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> animation = sweeps.plotting.animate(ds, at={"omega": 2.7}, periods=1, fps=2)
    >>> animation.to_jshtml().count("data:image/png")
    5
    """
    film = _film(sweep, at=at, periods=periods, fps=fps, page=page)
    return _Animation(film, film.show_frame, len(film.times), interval=1000.0 / fps)


class _Animation(FuncAnimation):
    """An animation that is embedded with all its frames, of which matplotlib would drop some."""

    def to_jshtml(self, *arguments: Any, **options: Any) -> str:
        """Return it as HTML with a player."""
        with mpl.rc_context({"animation.embed_limit": math.inf}):
            return super().to_jshtml(*arguments, **options)


class _Film(canvas.Picture):
    """A figure of a motion up to the time of a frame; what never changes is painted once."""

    def __init__(self, page: Page) -> None:
        """Make a figure without frames."""
        narrow = canvas.width_of(page) < NARROW
        super().__init__(page, 1.8 if narrow else 1.0)
        self.set_dpi(page.dpi or _DPI)
        if to_rgba(self.get_facecolor())[3] < 1.0:  # neither format has transparency
            self.set_facecolor(ground())
        ratios: dict[str, Any] = {"width_ratios": [0.3, 1.0] if narrow else [0.3, 1.0, 1.0]}
        panels = self.subplot_mosaic("mx;pp" if narrow else "mxp", **ratios)
        self.mass, self.over_time, self.phase_plane = (panels[name] for name in "mxp")
        self.mass.sharey(self.over_time)
        self.mass.set_axis_off()
        self.phase_plane.locator_params(axis="x", nbins=5)
        self._background: tuple[RendererBase | None, Any] = None, None

    def prepare(self, count: int, clearance: float, page: Page) -> None:
        """Let the motion that the panels show move, in so many frames after the first."""
        upper, lower = self.over_time, self.phase_plane
        self._curves = [
            (over_time, phases, np.vstack([*over_time.get_data(), phases.get_ydata()]))
            for over_time, phases in zip(upper.lines, lower.lines, strict=True)
            if over_time.get_transform() == upper.transData  # that of the stop is another
        ]
        self._motion = self._curves[0][2]
        props: dict[str, Any] = {"color": ink(), "marker": "o", "markersize": 4.5, "zorder": 4.0}
        self._heads = [panel.plot([], [], **props)[0] for panel in (upper, lower)]
        upper.autoscale(False)
        lower.autoscale(False)
        curves = [line for over_time, phases, _ in self._curves for line in (over_time, phases)]
        self.moving: list[Artist] = [*self._draw_mass(clearance, page), *curves, *self._heads]
        self.times = _frame_times(self._motion[0], count)

    def _draw_mass(self, clearance: float, page: Page) -> list[Artist]:
        """Draw the stop, the mass and its spring; return what moves."""
        panel, (low, high) = self.mass, self.over_time.get_ylim()
        size = high - low
        if page.ylim is None:
            low, high = low - (_MASS + _SHORTEST) * size, high + 0.5 * _STOP * size
            panel.set_ylim(low, high)
        panel.set_xlim(0.0, 1.0)
        panel.hlines([clearance, low], [0.0, 0.2], [1.0, 0.8], ink(), linewidths=[1.2, 2.4])
        stop = Rectangle((0.0, clearance), 1.0, _STOP * size, hatch="//////", linewidth=0.0)
        panel.add_patch(stop).set(facecolor=ground(), edgecolor=ink())
        self._block = Rectangle((0.2, 0.0), 0.6, _MASS * size, facecolor=data_colour(), ec="none")
        panel.add_patch(self._block)
        (self._spring,) = panel.plot(_SPRING, len(_SPRING) * [low], color=ink(), linewidth=0.8)
        return [self._block, self._spring]

    def show_frame(self, frame: int) -> list[Artist]:
        """Show the motion up to the time of a frame; return what moves."""
        time = float(self.times[frame])
        # At an impact, numpy takes the later of two states.
        now = np.array([time, *(np.interp(time, self._motion[0], row) for row in self._motion[1:])])
        for over_time, phases, rows in self._curves:
            past = rows[:, : rows[0].searchsorted(time, "right")]
            past = np.column_stack([past, now]) if rows is self._motion else past
            over_time.set_data(past[:2])
            phases.set_data(past[1:])
        for head, point in zip(self._heads, (now[:2], now[1:]), strict=True):
            head.set_data(point[:, None])
        self._block.set_y(now[1] - self._block.get_height())
        ends = self.mass.get_ylim()[0], self._block.get_y()
        self._spring.set_ydata(np.linspace(*ends, len(_SPRING)))
        return self.moving

    def draw(self, renderer: RendererBase) -> None:
        """Paint what is still, once with each renderer, and what moves."""
        if self.get_layout_engine() is not None or not isinstance(renderer, RendererAgg):
            super().draw(renderer)
            return
        if self._background[0] is not renderer:
            for artist in self.moving:
                artist.set_visible(False)
            super().draw(renderer)
            for artist in self.moving:
                artist.set_visible(True)
            self._background = renderer, renderer.copy_from_bbox(self.bbox)
        renderer.restore_region(self._background[1])
        for artist in self.moving:
            artist.draw(renderer)


@styled
def _film(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    periods: int | None = None,
    fps: int = FPS,
    page: Page = PAGE,
) -> _Film:
    """Draw the whole motion of a point, and make a film of it that ends with this picture."""
    point = sweep.cut(at)
    if periods is None:
        (label,) = point.labels
        periods = periods_shown(label.m if label else 0, _MOST_PERIODS, _UNKNOWN)
    if periods > _MOST_PERIODS:
        expected = f"expected: at most {_MOST_PERIODS}"
        raise Refused(f"periods = {periods:,} is not allowed in an animation; {expected}")
    film = _Film(page)
    count = round(fps * periods * float(np.clip(_IN_ALL / periods, _FASTEST, _SLOWEST)))
    width, height = np.rint(film.get_size_inches() * film.dpi).astype(int).tolist()
    if width * height * count > _MOST_PIXELS:
        raise Refused(
            f"{count:,} frames of {width} x {height} pixels are too many; expected: at most "
            f"{_MOST_PIXELS:,} pixels in all, by fewer periods, or a lower dpi, fps or width"
        )
    over_time, phase_plane = film.over_time, film.phase_plane
    velocity = Figure().add_subplot()  # which is not shown
    trajectory(sweep, at=at, periods=periods, page=page, ax=[over_time, velocity, phase_plane])
    if page.xlabel is None:
        over_time.set_xlabel(velocity.get_xlabel(), wrap=True)
    phase_plane.title.set(ha="right", x=1.0)  # the panel is narrow
    film.prepare(count, float(point["clearance"]), page)
    film.draw_without_rendering()  # lays it out
    with mpl.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
        film.set_layout_engine(None)
    film.show_frame(-1)
    return film


def _frame_times(t: np.ndarray, count: int) -> np.ndarray:
    """Return the times of frames, evenly spaced but for those nearest to an impact."""
    times = np.linspace(0.0, t[-1], count + 1)
    impacts = t[1:][np.diff(t) == 0.0]
    nearest, first = np.unique(np.rint(impacts / times[1]).astype(int), return_index=True)
    times[nearest] = impacts[first]
    return times


def save_animation(
    sweep: OpenedSweep,
    output: Path,
    description: tuple[str, str, str],
    fps: int = FPS,
    **options: Any,
) -> None:
    """Write the animation of a motion to a .gif or .mp4 file, either whole or not at all."""
    film = _film(sweep, fps=fps, **options)
    write = _mp4 if output.suffix.lower() == ".mp4" else _gif
    content = write(film, fps, description)
    with writing(output, "picture") as draft:
        draft.write(content)


def _mp4(film: _Film, fps: int, description: tuple[str, str, str]) -> bytes:
    """Return the content of an MP4 file, which ffmpeg makes."""
    title, _, text = description
    writer = FFMpegWriter(fps, metadata={"title": title, "comment": text})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "motion.mp4")
        try:
            with writer.saving(film, str(file), film.dpi):
                for frame in range(len(film.times)):
                    film.show_frame(frame)
                    writer.grab_frame(facecolor=film.get_facecolor(), transparent=False)
            return file.read_bytes()
        except (OSError, subprocess.CalledProcessError) as error:
            if error.__context__ and not isinstance(error.__context__, Exception):
                raise error.__context__ from None  # an interrupt, which ends ffmpeg, too
            raise Failed(f"ffmpeg cannot make the animation: {error}; a .gif needs none") from error


def _gif(film: _Film, fps: int, description: tuple[str, str, str]) -> bytes:
    """Return the content of a GIF file; its frames last whole hundredths of a second."""
    count, image = len(film.times), BytesIO()
    # The same colours in all frames, so that nothing flickers, with that of the ground as it is.
    samples = [_painted(film, frame) for frame in range(0, count, 1 + count // 8)]
    colours = Image.fromarray(np.vstack(samples)).quantize(255, Image.Quantize.FASTOCTREE)
    palette = np.reshape(colours.getpalette() or (), (-1, 3)).astype(np.uint8)
    palette[np.asarray(colours)[0, 0]] = samples[0][0, 0]
    colours.putpalette(palette.tobytes())
    frames = (
        Image.fromarray(_painted(film, frame)).quantize(palette=colours, dither=Image.Dither.NONE)
        for frame in range(count)
    )
    times = np.rint(100.0 / fps * np.arange(count + 1))
    durations = (10.0 * np.diff(times)).astype(int).tolist()
    about = "\n".join(description).encode()
    next(frames).save(
        image, "GIF", save_all=True, append_images=frames, loop=0, duration=durations, comment=about
    )
    return image.getvalue()


def _painted(film: _Film, frame: int) -> np.ndarray:
    """Return the pixels of a frame."""
    film.show_frame(frame)
    film.canvas.draw()
    return np.array(film.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]

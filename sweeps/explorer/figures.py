"""What live pictures share: `PixelFigure`, labels of axes, the `Worker` of their `Step`s."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from bokeh import models
from bokeh.plotting import figure

from sweeps.config.rig import Nomenclature
from sweeps.config.sweep import SweepConfig
from sweeps.explorer.view import View, Window, window_bounds
from sweeps.interrupts import Cancelled, check, this_thread
from sweeps.plotting.labels import DecadeLocator, as_variable, label, prefix_of, with_unit
from sweeps.plotting.pixels import cell_edges
from vibroimpact.jit import called_before_passes

#: Called with the configuration of a picture, its number of computed points, the seconds to compute
#: them, and the seconds since it was asked for.
Report = Callable[[SweepConfig, int, float, float], None]

_CLEAR = "#00000000"
#: Fewest and most columns and rows of a picture.
LEAST_PIXELS, _MOST = 16, 4096
#: A label may be longer than its axis by the space beside the canvas, and the label of the ordinate
#: lies above the canvas, beside the tools [px].
_BESIDE, _TOOLS = 40.0, 230.0
#: Unicode in place of TeX: a typesetter of formulas would add a megabyte to the page.
_LETTERS = {
    r"\omega": "ω", r"\nu": "ν", r"\sigma": "σ", r"\lambda": "λ", r"\pi": "π", r"\dot{x}^{-}": "ẋ⁻",
    r"\dot{x}": "ẋ", r"\mathrm{mod}": "mod", r"\approx": "≈", "~": " ", "\t": "", "_0": "₀",
    "_1": "₁", "^2": "²", "$": "",
}  # fmt: skip
#: Writes a tick divided by the factor of a prefix; steps are 1, 2 or 5 times a power of ten.
_TICK_WITH_PREFIX = """
const value = tick / factor;
if (log || ticks.length < 2) return String(Number(value.toPrecision(12)));
const digits = Math.ceil(-Math.log10(Math.abs(ticks[1] - ticks[0]) / factor) - 1e-6);
return value.toFixed(Math.min(Math.max(digits, 0), 15)).replace("-", "\u2212");
"""


def narrow(**rules: str) -> str:
    """Return a style sheet with the rules of a model on a narrow page, as that of a phone."""
    listed = "".join(
        f"{name.replace('_', '-')}: {value} !important;" for name, value in rules.items()
    )
    return f"@media (max-width: 699px) {{ :host {{ {listed} }} }}"


def without_tex(text: str) -> str:
    """Replace the TeX formulas in a text by Unicode letters."""
    for formula, letters in _LETTERS.items():
        text = text.replace(formula, letters)
    return text


def symbol(name: str, nomenclature: Nomenclature) -> str:
    """Return the symbol of a parameter or of a result as Unicode text."""
    return without_tex(as_variable(name, nomenclature).attrs["symbol"])


def value_text(name: str, view: View) -> str:
    """Return the symbol of a parameter with its value and, if the unit has a name, its unit."""
    variable = as_variable(name, view.nomenclature)
    number, unit = with_unit(variable, view.values[name])
    return without_tex(f"{variable.symbol} = {number:.6g} {unit}".rstrip())


def label_of(axis: Any, name: str, view: View, size: float, pixels: float = math.inf) -> str:
    """Return the label of an axis with the prefix that `plot` gives to numbers of this size."""
    # Beyond so many pixels, the meaning is left out.
    variable = as_variable(name, view.nomenclature)
    prefix, factor = prefix_of(variable, size)
    log = isinstance(axis.ticker, models.FixedTicker)
    if axis.tags != [log, factor]:
        args, is_plain = {"factor": factor, "log": log}, not log and factor == 1.0
        scaled = models.CustomJSTickFormatter(args=args, code=_TICK_WITH_PREFIX)
        axis.tags = [log, factor]
        axis.formatter = models.BasicTickFormatter() if is_plain else scaled
    text = without_tex(label(variable, prefix))
    fits = 7.0 * len(text) < pixels
    return text if fits else text.removeprefix(variable.long_name).strip()


#: Reports which picture is on the screen: one drawn in a frame is visible in the next.
_PAINTED = """
const number = pixels.data.number[0];
requestAnimationFrame(() => requestAnimationFrame(() => {painted.value = number}));
"""


class PixelFigure:
    """A figure with common tools, maybe over the `x_range` of another; it reports its pictures."""

    def __init__(self, name: str, report: Report, x_range: models.Range1d | None = None) -> None:
        self._report = report
        self.figure = figure(
            tools="pan,wheel_zoom,box_zoom,undo,redo,reset,save", active_scroll="wheel_zoom",
            x_range=x_range or models.Range1d(0.0, 1.0), y_range=models.Range1d(0.0, 1.0),
            name=name, sizing_mode="stretch_both", min_height=120, lod_threshold=None,
            # The ordinate is named above, so that the plot has the whole width of a narrow page.
            title="", toolbar_location="above",
        )  # fmt: skip
        self.figure.toolbar.logo = None
        self.figure.title.update(text_font_style="italic", text_color="#444444")
        #: The content of the tab of this figure.
        self.layout: models.LayoutDOM = self.figure
        #: Columns and rows of the canvas; 0 until the browser reports them.
        self.size = (0, 0)
        columns: dict[str, list[Any]] = {key: [] for key in ("image", "x", "y", "dw", "dh")}
        self.source = models.ColumnDataSource(columns, name=f"{name} pixels")
        #: The numbers of the picture that the browser painted last and of the one sent last.
        self.painted, self.sent = models.NumericInput(visible=False, value=0), 0
        arguments = {"pixels": self.source, "painted": self.painted}
        self.source.js_on_change("data", models.CustomJS(args=arguments, code=_PAINTED))
        self._colours = models.LinearColorMapper(palette=[_CLEAR], low=-0.5, high=0.5)
        self.figure.image("image", color_mapper=self._colours, source=self.source, level="image")
        props = {"visible": False, "level": "overlay"}
        self._veil = models.BoxAnnotation(
            fill_color="white", fill_alpha=0.65, line_color=None, **props
        )
        self._waits = models.Label(
            x=0, y=0, x_units="screen", y_units="screen", text_align="center",
            text_baseline="middle", text_font_size="14px", padding=6, name=f"{name} waits",
            background_fill_color="white", background_fill_alpha=0.85, **props,
        )  # fmt: skip
        for annotation in (self._veil, self._waits):
            self.figure.add_layout(annotation)

    def resize(self, side: str, pixels: int) -> None:
        """Set the width or the height of the canvas, as the browser reports it."""
        columns, rows = self.size
        self.size = (pixels, rows) if side == "inner_width" else (columns, pixels)

    def wait(self, text: str) -> None:
        """Dim the picture and say over it what it waits for; with an empty text, end that."""
        width, height = self.size
        self._waits.update(text=text, x=width / 2, y=height / 2, visible=bool(text))
        self._veil.visible = bool(text)

    @property
    def is_painted(self) -> bool:
        """Whether the browser has painted the picture that was sent last."""
        return bool(self.painted.value == self.sent)

    @property
    def resolution(self) -> tuple[int, int]:
        """Number of columns and rows to compute."""
        columns, rows = (min(max(size, LEAST_PIXELS), _MOST) for size in self.size)
        return columns, rows

    @property
    def windows(self) -> tuple[Window, Window]:
        """The windows of the abscissa and of the ordinate."""
        x, y = self.figure.x_range, self.figure.y_range
        return (x.start, x.end), (y.start, y.end)

    def set_axis(self, side: str, name: str, view: View, window: Window) -> None:
        """Set the label, the scale, the window and the bounds of axis x or y."""
        axis, log = getattr(self.figure, f"{side}axis"), name in view.log
        allowed = window_bounds(name, view, window) if name in view.values else None
        scale = models.LogScale if log else models.LinearScale
        if not isinstance(getattr(self.figure, f"{side}_scale"), scale):
            setattr(self.figure, f"{side}_scale", scale())
            axis.ticker = models.FixedTicker() if log else models.BasicTicker()
        if log:  # Bokeh's own ticks have no label below 1 from 0.1 to 10
            axis.ticker.ticks = DecadeLocator(numticks=9).tick_values(*window)
            first, last = (math.floor(math.log10(end)) for end in window)
            minor = np.outer(10.0 ** np.arange(first, last + 1), range(2, 10)).ravel().tolist()
            axis.ticker.minor_ticks = minor
        self.label(side, name, view, window)
        set_range(getattr(self.figure, f"{side}_range"), window, allowed)

    def label(self, side: str, name: str, view: View, window: Window) -> None:
        """Set the label and the ticks of axis x or y for a window."""
        figure, size, pixels = self.figure, max(map(abs, window)), self.size[0] + _BESIDE
        if side == "x":
            figure.xaxis.axis_label = label_of(figure.xaxis, name, view, size, pixels)
        else:
            figure.title.text = label_of(figure.yaxis, name, view, size, pixels - _TOOLS)

    def move(self, across: float, upwards: float, size: float) -> None:
        """Move the window by fractions of its width and height, and scale it about its centre."""
        figure = self.figure
        sides = (figure.x_range, figure.x_scale, across), (figure.y_range, figure.y_scale, upwards)
        for model, scale, by in sides:
            if by or size != 1.0:
                log = isinstance(scale, models.LogScale)
                low, high = np.log([model.start, model.end]) if log else (model.start, model.end)
                limits = np.array([-0.5, 0.5]) * size + 0.5 + by
                limits = low + (high - low) * limits
                least, most = model.bounds or (None, None)
                start, end = np.clip(np.exp(limits) if log else limits, least, most).tolist()
                model.update(start=start, end=end)

    def set_colours(self, colours: Sequence[str]) -> None:
        """Set the colours of the pixel values 1, 2, ...; 0 is transparent."""
        self._colours.update(palette=[_CLEAR, *colours], low=-0.5, high=len(colours) + 0.5)

    def set_pixels(self, pixels: np.ndarray, x: Window, y: Window, **columns: list[Any]) -> None:
        """Show pixels, shape (rows, columns), between these edges."""
        edges = {"x": [x[0]], "y": [y[0]], "dw": [x[1] - x[0]], "dh": [y[1] - y[0]]}
        self.sent += 1
        self.source.data = {"image": [pixels], "number": [self.sent], **edges, **columns}


def outer_edges(values: np.ndarray, log: bool) -> Window:
    """Return the outer edges of the first and the last cell around increasing values."""
    low, *_, high = cell_edges(values, log).tolist()
    return low, high


def set_range(model: models.Range1d, window: Window, allowed: Any = None) -> None:
    """Set a range and its bounds."""
    # The browser would clip the window of a new axis to the old bounds.
    if model.bounds != allowed:
        model.bounds = None
    model.update(start=window[0], end=window[1])
    model.bounds = allowed


@dataclass(frozen=True)
class Step:
    """One piece of work."""

    name: str  # of the place in the page that it fills; a later step may have a better result
    key: Any  # determines the result; if its place has this or a better one, the step is skipped
    compute: Callable[[], Any]  # returns the result; called in the thread of the worker
    #: Shows the result, given the seconds since the request; in the thread of the document.
    show: Callable[[Any, float], None]


class Worker(ThreadPoolExecutor):
    """One thread that computes the steps of the newest request one after the other."""

    def __init__(
        self,
        post: Callable[[Callable[[], None]], None],  # runs a function in the document's thread
        fail: Callable[[str], None],  # is called there with the text of an error
    ) -> None:
        super().__init__(1, "explore")
        self._post, self._fail = post, fail
        self._stale, self._closed = np.zeros((2, 1), np.int64)
        #: The result that each place holds, and those that it waits for, by their keys.
        self._done: dict[str, Any] = {}
        self._requested: dict[str, list[Any]] = {}
        #: The current step: its name, whether it is the first of that name, and its start time.
        self.busy: tuple[str, bool, float] | None = None

    def ask(self, steps: Sequence[Step]) -> None:
        """Replace the waiting steps, and cancel the current one."""
        # The first step of a name is not cancelled, because it compiles.
        self._stale[0] = 1
        self._requested = {}
        for step in steps:
            self._requested.setdefault(step.name, []).append(step.key)
        if not self._closed[0]:
            self._stale = np.zeros(1, np.int64)
            self.submit(self._take_all, steps, self._stale, perf_counter())

    def is_late(self, name: str) -> bool:
        """Whether a place does not hold what the newest request is for."""
        return self._done.get(name) not in self._requested.get(name, [])

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel all steps, and end the thread."""
        self._closed[0] = self._stale[0] = 1
        super().shutdown(wait, cancel_futures=cancel_futures)

    def _take_all(self, steps: Sequence[Step], stale: np.ndarray, requested_at: float) -> None:
        """Compute the steps of a request until a newer one arrives."""
        for i, step in enumerate(steps):
            if stale[0]:
                return
            keys = [later.key for later in steps[i:] if later.name == step.name]
            if self._done.get(step.name) not in keys:
                self._take(step, stale, requested_at)

    def _take(self, step: Step, stale: np.ndarray, requested_at: float) -> None:
        """Compute a step and post its result or its error, unless it is cancelled."""
        first = step.name not in self._done
        self.busy = step.name, first, perf_counter()
        try:
            this_thread.flag = self._closed if first else stale
            check()
            with called_before_passes(check):  # a pass takes 3 s at most
                result = step.compute()
        except Cancelled:
            return
        except Exception as error:
            self._post(partial(self._say, str(error) or type(error).__name__, stale))
        else:
            self._done[step.name] = step.key
            self._post(partial(step.show, result, perf_counter() - requested_at))
        finally:
            self.busy = None

    def _say(self, text: str, stale: np.ndarray) -> None:
        """Say the error of a step unless it is of an earlier request."""
        if not stale[0]:
            self._fail(text)

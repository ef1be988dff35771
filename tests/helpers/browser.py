"""A headless Chromium for the tests of the live picture, and access to its pages."""

import base64
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from sweeps.explorer.figures import value_text
from sweeps.explorer.live_maps import Tiles
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.server import Explorer
from sweeps.explorer.view import DIAGRAM_TAB, View

#: No downloads and no requests to the network.
_OPTIONS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
#: What a page shows: a cascade, at once.
SCENE = {
    "name": "scene",
    "oscillator": {"h": 0.05, "R": 0.8, "omega": {"start": 2.4, "stop": 3.5, "num": 50}, "f": 1.0},
    "record": {"transient": 60, "periods": 4, "impacts": 8},
}
#: A limit that is only exceeded if the page hangs [s].
PATIENCE = 300.0
#: Variable that turns a missing browser into a failure instead of a skip.
REQUIRED = "VIBROIMPACT_TEST_BROWSER"


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a browser; without one, skip the test, or fail if ``REQUIRED`` is set."""
    names = ("chromium", "chromium-browser", "google-chrome")
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        reason = "there is no Chromium; install one, on Debian with: apt install chromium"
        pytest.fail(reason) if os.environ.get(REQUIRED) else pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=_OPTIONS)
        yield browser
        browser.close()


class Window:
    """A page in the browser beside the `LivePage` of the server in this process.

    It is small, since every pixel is computed, painted and compared, but wide enough for the
    controls beside the picture.
    """

    def __init__(
        self,
        browser: Any,
        explorer: Explorer,
        size: tuple[int, int] = (720, 360),
    ) -> None:
        self.requests: list[str] = []
        self.problems: list[str] = []
        self.size = {"width": size[0], "height": size[1]}
        self.tab = browser.new_page(viewport=self.size)
        self.tab.set_default_timeout(1000.0 * PATIENCE)
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.on("pageerror", lambda error: self.problems.append(str(error)))
        self.explorer = explorer
        self.open(explorer.address)

    def open(self, address: str) -> None:
        """Open an address, which makes a page of its own, and wait for its picture."""
        self.tab.goto(address)
        # A page that took long to load is made again.
        self.tab.wait_for_function("window.Bokeh?.documents?.length")
        self.page: LivePage = self.explorer.pages[-1]
        self.settle(lambda: self.page.diagram.snapshot is not None)
        # A drag that begins with 300 ms of rest is ignored, and a busy machine may be that slow.
        self.tab.evaluate("Bokeh.require('core/ui_gestures').UIGestures.press_threshold = 1e9")

    def show(self, view: View) -> None:
        """Show a view in the first size without a history, whatever was done before."""
        self.tab.set_viewport_size(self.size)
        self.model("diagram", "{m.toolbar.tools.find((t) => t.type === 'PanTool').active = true}")
        self.page.document.add_next_tick_callback(lambda: self.page.change(lambda _: view))
        self.settle(lambda: self.page.view == view)
        self.model("diagram", "{Bokeh.index.find_one(m).state.clear()}")

    def settle(self, condition: Callable[[], bool] = lambda: True) -> None:
        """Wait until a condition holds, the worker is idle, and the browser has the picture."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if self.idle() and condition() and self.painted():
                return
            self.tab.wait_for_timeout(50)
        place = f"{self.page.view}, {self.page.motion.text.text}"
        raise AssertionError(f"the page did not come to rest: {place}")

    def tiles(self, name: str) -> Tiles:
        """Wait until a complete map is in the browser; return it."""
        picture = {"map": self.page.map, "basins": self.page.basins}[name]
        code = "{const i = m.data.image[0]; return i && [...i.shape, i.reduce((a, b) => a + b)]}"
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            filling = picture.filling
            shown = self.page._picture is picture
            if (
                self.idle()
                and shown
                and filling
                and filling.config == picture.saved(self.page.view)
            ):
                advance, size = filling.advance, filling.config.sweep.grid.size
                tiles = self.page.worker.submit(advance, size).result(PATIENCE)
                expected = [*tiles.pixels.shape, int(tiles.pixels.sum(dtype=int))]
                if self.model(f"{name} pixels", code) == expected and self.idle():
                    return tiles
            self.tab.wait_for_timeout(50)
        raise AssertionError(f"no map: {self.page.controls.error.text}")

    def shows_motion(self) -> bool:
        """Whether the browser has the text, sent last, on the motion at the mark."""
        view, text = self.page.view, self.page.motion.text.text
        is_at_mark = view.marked and value_text(view.axis, view) in text
        return is_at_mark and self.model("motion: text", "{return m.text}") == text

    def idle(self) -> bool:
        """Wait until all requests are computed and sent by the server."""
        sent = threading.Event()
        self.page.worker.submit(self.page.document.add_next_tick_callback, sent.set)
        return sent.wait(PATIENCE)

    def painted(self) -> bool:
        """Whether the browser has the window and the fine picture of the view."""
        shown, (columns, rows) = self.page.diagram.snapshot, self.page.diagram.size
        view = self.page.view
        if view.tab != DIAGRAM_TAB:
            return True
        if self.page._waiting or shown is None or shown.pixels.shape != (rows, columns):
            return False
        densest = self.page.diagram.configurations(view)[-1]
        if (shown.config, shown.view.ordinate) != (densest, view.ordinate):
            return False
        # The labels of the ticks may change the size of the canvas in the next frame.
        ends = self.model(
            "diagram",
            "{const {x_range: x, y_range: y} = m; return new Promise((found) =>"
            " requestAnimationFrame(() => requestAnimationFrame(() => found("
            "[x.start, x.end, y.start, y.end, m.inner_width, m.inner_height]))))}",
        )
        seen = (*shown.view.xlim, *shown.window, columns, rows)
        return tuple(ends) == seen and np.array_equal(self.pixels(), shown.pixels)

    def pixels(self) -> np.ndarray:
        """Return the picture in the browser, shape (rows, columns)."""
        code = (
            "{const i = m.data.image[0]; if (i === undefined) return ['', [0, 0]];"
            "const b = new Uint8Array(i.buffer, i.byteOffset, i.length); let s = '';"
            "for (let k = 0; k < b.length; k += 8192)"
            " s += String.fromCharCode(...b.subarray(k, k + 8192)); return [btoa(s), i.shape]}"
        )
        data, shape = self.model("diagram pixels", code) or ("", (0, 0))
        return np.frombuffer(base64.b64decode(data), np.uint8).reshape(shape)

    def model(self, name: str, code: str) -> Any:
        """Run JavaScript in which `m` is the model with a name."""
        return self.tab.evaluate(
            f"(() => {{const m = Bokeh.documents[0]?.get_model_by_name('{name}');"
            f"if (m == null) return null; return (() => {code})()}})()"
        )

    def box(self, name: str = "diagram") -> dict[str, float]:
        """Return the position of the frame of a figure on the screen."""
        return self.tab.evaluate(
            "(name) => {const m = Bokeh.documents[0].get_model_by_name(name);"
            "const v = Bokeh.index.find_one(m); const b = v.el.getBoundingClientRect();"
            "const f = v.frame.bbox; return {x: b.x + f.left, y: b.y + f.top, width: f.width,"
            " height: f.height}}",
            name,
        )

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag the mouse between two points of the diagram, as fractions of its size."""
        box, mouse = self.box(), self.tab.mouse
        x, y, width, height = (box[name] for name in ("x", "y", "width", "height"))
        places = [(x + u * width, y + v * height) for u, v in (start, end)]
        mouse.move(*places[0])
        mouse.down()
        mouse.move(*places[1], steps=5)
        mouse.up()

    def click(self, u: float, v: float, name: str = "diagram") -> None:
        """Click into a figure, at fractions of its width and height."""
        box = self.box(name)
        self.tab.mouse.click(box["x"] + u * box["width"], box["y"] + v * box["height"])

    def wheel(self, delta: float, at: tuple[float, float] = (0.5, 0.5)) -> None:
        """Turn the wheel over a point of the diagram."""
        box = self.box()
        self.tab.mouse.move(box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"])
        self.tab.mouse.wheel(0, delta)

    def tool(self, title: str) -> None:
        """Press a button of the toolbar."""
        self.tab.locator(f".bk-tool-icon-{title}").first.click()

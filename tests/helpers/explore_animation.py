"""Draw configs/pictures/explore.gif: the live picture in a browser, gesture by gesture.

Run it from the root of the repository: ``python -m tests.helpers.explore_animation``.
"""

import io

from PIL import Image

import sweeps
from tests.helpers.browser import Window, chromium
from tests.helpers.places import CONFIGS


def main() -> None:
    """Zoom into a window of the chaos, show a motion there, and the map beside it."""
    explorer = sweeps.explore(sweeps.load_config(CONFIGS / "quickstart.yaml"))
    frames: list[tuple[Image.Image, int]] = []

    def keep(milliseconds: int) -> None:
        window.tab.wait_for_timeout(200)
        image = Image.open(io.BytesIO(window.tab.screenshot()))
        image = image.convert("RGB").resize((720, 450), Image.Resampling.LANCZOS)
        frames.append((image.quantize(48, dither=Image.Dither.NONE), milliseconds))

    with chromium() as browser:
        window = Window(browser, explorer, size=(1120, 700))
        page = window.page
        keep(1200)
        for _ in range(8):
            before = page.view.xlim
            window.wheel(-150.0, (0.6, 0.55))
            window.settle(lambda before=before: page.view.xlim != before)
            keep(250)
        window.tab.get_by_text("exact branches").click()
        window.settle(lambda: window.model("flip marks", "{return m.visible}"))
        keep(1200)
        window.click(0.2, 0.5)
        window.settle(lambda: bool(page.motion.text.text))
        keep(900)
        for i in range(5):
            before = page.motion.text.text
            window.drag((0.2 + 0.12 * i, 0.4), (0.32 + 0.12 * i, 0.4))
            window.settle(lambda before=before: page.motion.text.text != before)
            keep(600)
        window.tool("reset")
        window.settle(lambda: page.view.ylim is None)
        window.tab.get_by_text("map of classes").click()
        window.tiles("map")
        keep(1800)
    explorer.close()
    images, durations = zip(*frames, strict=True)
    path = CONFIGS / "pictures" / "explore.gif"
    images[0].save(path, save_all=True, append_images=images[1:], duration=list(durations), loop=0)
    print(f"{path}: {len(images)} frames, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

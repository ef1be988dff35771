"""Pictures as EPS: what they look like without transparency, and what their files say; TIFF."""

import logging
import re

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from PIL import Image

from sweeps.errors import Refused
from sweeps.plotting import Page, plot
from sweeps.plotting.saving import save
from tests.helpers.equal_points import equal_points

BLUE = "#0072B2"


def images(path):
    """Return the images in an EPS file, shape (rows, columns, 3)."""
    image = r"(\d+) (\d+) 8 \[[^\]]*\]\n\{\n.*?colorimage\n([0-9a-f\n]+)"
    found = re.findall(image, path.read_text(), re.DOTALL)
    pixels = [np.frombuffer(bytes.fromhex(digits), np.uint8) for *_, digits in found]
    sizes = [(int(rows), int(columns), 3) for columns, rows, _ in found]
    return [*map(np.reshape, pixels, sizes)]


def panel_with(*artists):
    """Return a figure whose panel has a white background, and artists as `draw(panel)` adds."""
    figure = Figure(figsize=(2.0, 2.0), dpi=100)
    panel = figure.add_axes((0.2, 0.2, 0.7, 0.7))
    panel.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    for draw in artists:
        draw(panel)
    return figure


def transparent(panel):
    panel.fill_between([0.0, 1.0], 0.0, 1.0, color=BLUE, alpha=0.25, rasterized=True, zorder=2)


def black(panel):
    panel.axhline(0.5, color="black", linewidth=5.0, zorder=1)


def red_pixels(panel):
    panel.fill_between([0.0, 0.1], 0.9, 1.0, color="red", rasterized=True, zorder=4)
    panel.fill_between([0.9, 1.0], 0.0, 0.1, color="red", rasterized=True, zorder=4)


def test_transparent_pixels_have_the_colour_that_they_have_on_paper(tmp_path):
    save(panel_with(transparent), tmp_path / "a.eps")
    (image,) = images(tmp_path / "a.eps")
    middle = image[image.shape[0] // 2, image.shape[1] // 4]
    expected = 255.0 * (0.25 * np.array(to_rgb(BLUE)) + 0.75)
    np.testing.assert_allclose(middle, expected, atol=2.0)


def test_pixels_hide_nothing_that_is_below_them(tmp_path):
    """An image of PostScript has no holes: it contains what is seen between the pixels."""
    figure = panel_with(black, transparent, red_pixels)
    save(figure, tmp_path / "a.eps")
    save(figure, tmp_path / "a.png")
    (image,) = images(tmp_path / "a.eps")
    row = image[:, image.shape[1] // 2].astype(int)
    shown = (255.0 * imread(tmp_path / "a.png")).astype(int)
    column = shown[:, int(0.55 * shown.shape[1]), :3]
    assert row.sum(axis=1).min() == pytest.approx(column.sum(axis=1)[40:-60].min(), abs=6)
    assert row.sum(axis=1).min() < 0.4 * row.sum(axis=1).max()


def test_labels_and_ticks_stay_texts_and_lines(tmp_path):
    def named(panel):
        panel.text(0.5, 0.5, "label", zorder=3)
        panel.set_xlabel("abscissa")

    save(panel_with(red_pixels, named), tmp_path / "a.eps")
    text = (tmp_path / "a.eps").read_text()
    written = "".join(re.findall(r"\((.*?)\)", text) + re.findall(r"/(\w) glyphshow", text))
    assert "label" in written and "abscissa" in written


def test_transparent_lines_are_lighter_and_matplotlib_warns_of_nothing(tmp_path, caplog):
    def faint(panel):
        panel.plot([0.0, 1.0], [0.0, 1.0], color="black", alpha=0.4)

    with caplog.at_level(logging.WARNING):
        save(panel_with(faint), tmp_path / "a.eps")
    assert not caplog.records
    assert re.search(r"^0\.6 setgray", (tmp_path / "a.eps").read_text(), re.MULTILINE)


def test_the_file_has_a_whole_title_and_its_source_in_short_lines_and_no_date(
    tmp_path, monkeypatch
):
    """Adobe's conventions allow 255 characters, and continue a line after a plus.

    The same picture gives the same bytes at any time: `time.ctime` is not in it.
    """
    title = "größe " + " ".join(f"part-{number}" for number in range(70))
    command = "vibroimpact plot " + " ".join(f"part-{number}.h5" for number in range(70))
    files, about = [tmp_path / "0.eps", tmp_path / "1.eps"], f"command: {command}\nname: a"
    for path in files:
        monkeypatch.setattr("time.ctime", lambda name=path.name: f"at {name}")
        save(panel_with(transparent), path, (title, "a program", about))
    one, other = (path.read_bytes() for path in files)
    assert one == other and b"CreationDate" not in one
    lines = one.decode("ascii").splitlines()
    assert lines[0] == "%!PS-Adobe-3.0 EPSF-3.0" and max(map(len, lines)) <= 255
    head, _, body = one.decode("ascii").partition("%%EndComments\n")
    head, body = head.replace("\n%%+", "").splitlines(), body.replace("\n%+", "").splitlines()
    assert "%%Title: " + title.replace("größe", r"gr\xf6\xdfe") in head
    assert "%%Creator: a program" in head
    assert f"% command: {command}" in body and "% name: a" in body


@pytest.mark.slow
def test_the_fonts_are_of_a_type_that_journals_take_and_the_file_says_where_it_comes_from(tmp_path):
    command = "vibroimpact plot map.h5"
    plot(equal_points(), tmp_path / "a.eps", "map", page=Page(dpi=50), command=command)
    text = (tmp_path / "a.eps").read_text("ascii")
    assert set(re.findall(r"/FontType (\d+)", text)) == {"42"}
    for part in ("% oscillator: {h: 0.1", "Creator: vibroimpact 0", "% computed with", command):
        assert part in text


def test_a_tiff_has_the_pixels_of_the_png_and_its_description(tmp_path):
    for name in ("a.png", "a.tiff"):
        plot(equal_points(), tmp_path / name, "map", page=Page(dpi=60, width=3.4))
    with Image.open(tmp_path / "a.tiff") as image:
        assert image.mode == "RGB" and image.info["compression"] == "tiff_lzw"
        assert image.info["dpi"] == pytest.approx((60, 60), abs=0.01)
        assert "configuration:" in image.tag_v2[270] and "vibroimpact" in image.tag_v2[305]
        pixels = np.asarray(image) / 255.0
    np.testing.assert_allclose(pixels, imread(tmp_path / "a.png")[..., :3], atol=1e-6)


@pytest.mark.parametrize("ending", ["eps", "pdf", "svg"])
def test_only_pixels_limit_the_size_of_a_file_of_vectors(tmp_path, ending):
    file = tmp_path / f"a.{ending}"
    with mpl.rc_context({"savefig.dpi": 9000}):
        save(panel_with(black), file)
        with pytest.raises(Refused, match="18000 x 18000 pixels is too large"):
            save(panel_with(red_pixels), tmp_path / f"b.{ending}")
    assert 0 < file.stat().st_size < 1e5

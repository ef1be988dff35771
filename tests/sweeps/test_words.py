"""The words of legends and reports are those of the glossary in configs/words.md."""

import json
import re
from pathlib import Path

import pytest
import yaml

from sweeps import bifurcations, branches, curves, open_sweep, plotting
from sweeps.attractor.knocks import Knock
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.contents import number_at
from sweeps.plotting.style import EVIDENCE, REGIMES, STATUS_COLOURS
from tests.helpers import gallery
from tests.helpers.commands import accepted
from tests.helpers.places import CONFIGS
from tests.helpers.sweep_files import swept
from tests.sweeps.test_gallery import script
from vibroimpact.status import Evidence, Status

pytestmark = pytest.mark.slow

RECORD = "record: {transient: 20, periods: 32, impacts: 4, diagnostics: [period, lyapunov]}\n"
#: A map with orbits, rests and chaos; a line that is followed both ways; starts on two attractors.
FILES = {
    "map": "oscillator: {h: 0.02, R: {start: 0, stop: 0.9, num: 7}, omega: "
    "{start: 1, stop: 3, num: 12}, f: 1}\n" + RECORD,
    "line": "oscillator: {h: 0.05, R: 0.8, f: 1, clearance: 1.5, omega: "
    "{start: 1.2, stop: 1.7, num: 26}}\nfollow: {axis: omega, direction: both}\n" + RECORD,
    "starts": "oscillator: {h: 0, R: 0.8, f: 1, omega: [1.3, 1.35]}\nstart: {x0: "
    "{start: -3, stop: 0, num: 8}, v0: {start: -2, stop: 2, num: 8}}\n" + RECORD,
}


def glossary():
    """Return the words in the first cells of the tables of the glossary that stand in legends."""
    cells = re.findall(r"^\| ([^|]+) \|", (CONFIGS / "words.md").read_text(), re.MULTILINE)
    return {word for cell in cells for word in re.findall(r"`([^`]+)`", cell)}


def phrases(text):
    """Split a text into the phrases that the glossary has, without numbers, units and symbols."""
    text = re.sub(r"\([^)]*\)|\$[^$]*\$", "", text)
    text = re.sub(r"\b\d+/\d+\b", "m/q", text)
    text = text.replace("attractors at", "@").replace(" not shown", ",not shown")
    parts = re.split(r"[,;:→\n]| or | for | at |\d[\d.,e+-]*", text)
    return {part.strip().replace("@", "attractors at") for part in parts} - {"", "?", "%", "to"}


def unexplained(texts):
    known = glossary()
    found = {phrase for text in texts for phrase in phrases(text)}
    return {phrase for phrase in found if not {phrase, phrase.removesuffix("s")} & known}


def legends(figure):
    """Return all texts of the legends of a figure, without their titles."""
    panels = [panel.get_legend() for panel in figure.axes]
    every = [*figure.legends, *(legend for legend in panels if legend is not None)]
    return [text.get_text().replace("\n", " ") for one in every for text in one.get_texts()]


def test_the_words_of_all_regimes_and_outcomes():
    words = [regime.word for regime in REGIMES]
    words += [one.word for one in (*EVIDENCE, *Status)]
    assert {Status.PENDING, *STATUS_COLOURS} <= set(Status) and len(EVIDENCE) == len(Evidence) - 1
    words.remove("pending")  # which is called by its meaning
    assert not unexplained([*words, Status.PENDING.meaning])
    assert unexplained(["unsettled", "1/1, not settled yet (3 %)"]) == {
        "unsettled", "not settled yet"
    }  # fmt: skip


def test_the_words_of_the_legends(files, monkeypatch):
    knock = Knock(phase=1.0, x=-1.0, v=0.5, harmless=0.1, harmful=0.2)  # to seek it takes long
    monkeypatch.setattr("sweeps.attractor.knocks._Attractors.worst", lambda *_: knock)
    monkeypatch.setattr("sweeps.opened.result_cache.root", lambda: Path("kept"))
    with (
        open_sweep(files / "map.h5") as whole,
        open_sweep(files / "line.h5") as line,
        open_sweep(files / "starts.h5") as starts,
    ):
        figures = [plotting.parameter_map(whole, exact=curves(whole, classes=[(1, 1)]))]
        for name in ("status", "class_evidence", "impulse", "rest_fraction", "lyapunov"):
            assert number_at(OpenedSweep(whole), name) is not None
            figures.append(plotting.parameter_map(whole, quantity=name))
        found = branches(line)
        figures += [
            plotting.bifurcation(line, exact=found, below=["lyapunov"]),
            plotting.bifurcation(line, coordinate="impact_v", at={"direction": "up"}, exact=found),
            plotting.bifurcation(whole, at={"R": 0.9}, axes=["omega"], coordinate="impact_v"),
            plotting.section(whole, color="period"),
            plotting.trajectory(whole, at={"R": 0.9, "omega": 3.0}),
            plotting.basins(starts, at={"omega": 1.3}),
            plotting.attractor_diagram(starts),
            plotting.integrity(starts),
        ]
        texts = [text for figure in figures for text in legends(figure)]
    shown = {phrase for text in texts for phrase in phrases(text)}
    assert {"chaotic", "rest", "m/q", "on its way to m/q", "least knock"} <= shown
    assert not unexplained(texts)


def test_the_words_of_the_reports(files, tmp_path):
    for path in files.glob("*.h5"):
        lines = accepted("info", path).splitlines()
        (first, *_) = (line.split(None, 1)[1] for line in lines if line.startswith("classes "))
        assert not unexplained([first])
        found = bifurcations(path, axis="omega")
        for column in ("kind", "before", "after"):
            assert not unexplained(re.sub(r" ?\d+/\d+", "", word) for word in found[column])
    said = accepted("attractors", files / "starts.h5", "--csv", tmp_path / "a.csv").splitlines()
    assert not unexplained(line.split()[1] for line in said[1:3])


IN_GALLERY = json.loads(gallery.WORDS.read_text())


def coarser(name):
    """Return overrides of a scene of configs/ with at most six values of each range."""

    def ranges(key, value):
        if isinstance(value, dict):
            if "num" in value:
                yield f"{key}.num={min(value['num'], 6)}"
            for part, inner in value.items():
                yield from ranges(f"{key}.{part}" if key else part, inner)

    return list(ranges("", yaml.safe_load((gallery.CONFIGS / f"{name}.yaml").read_text())))


def comparable(words):
    """Return title, labels and legend title without numbers, which depend on the points."""
    parts = [part for part in re.split(", |\\n", words["title"]) if "impacts" not in part]
    texts = [*parts, *words["labels"], words["legend"][0] if words["legend"] else ""]
    return {gallery.without_numbers(text) for text in texts} - {""}


@pytest.mark.parametrize("name", gallery.ARGUMENTS)
def test_a_picture_of_the_gallery_has_the_words_of_today(name, unpainted, no_knocks):
    """If not: python -m tests.helpers.gallery. Title and axes do not depend on the grid."""
    stored = IN_GALLERY[name]
    drawn = gallery.drawn(name, *coarser(name), exact=False)
    new, old = comparable(drawn), comparable(stored)
    legend = {gallery.without_numbers(stored["legend"][0])} if stored["legend"] else set()
    assert new - legend <= old and old - legend <= new
    assert unexplained(stored["legend"][1:]) == set()


def test_words_are_kept_of_every_picture_as_it_is():
    pictures = {path.stem for path in gallery.PICTURES.glob("*.png")} - {"accuracy-speed"}
    assert pictures == IN_GALLERY.keys()
    for name, words in IN_GALLERY.items():
        assert words["sha256"] == gallery.digest(gallery.PICTURES / f"{name}.png"), name


@pytest.mark.parametrize(
    ("diagnostics", "word"), [(["period"], "unknown"), (["period", "lyapunov"], "chaotic")]
)
def test_motions_without_a_class_have_the_words_of_the_reports(diagnostics, word):
    """At h = 0, R = 0.8, omega = 2.8 the motion is chaotic, which only exponents show."""
    points = {"omega": [2.8, 2.8], "f": [1.0, 1.0], "matrix": ["A", "B"]}
    record = {"transient": 200, "periods": 100, "impacts": 0, "diagnostics": diagnostics}
    scene = {"points": points, "oscillator": {"h": 0.0, "R": 0.8}, "record": record}
    assert script("tolerances_picture").classes(swept(scene)) == {word: 2}

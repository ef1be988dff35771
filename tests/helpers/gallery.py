"""Draw the pictures of configs/pictures, and list the words in them in words.json.

Run it from the root of the repository: ``python -m tests.helpers.gallery``, or with the names of
some pictures, as ``quickstart cascade``. All take a few minutes. accuracy-speed.png, which measures
this machine, is drawn by ``vibroimpact bench accuracy-speed``, and explore.gif by
``python -m tests.helpers.explore_animation``.
"""

import hashlib
import importlib.util
import json
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

from sweeps import open_sweep
from sweeps.plotting.saving import save as write
from tests.helpers.commands import accepted
from tests.helpers.places import CONFIGS

PICTURES = CONFIGS / "pictures"
WORDS = PICTURES / "words.json"
#: For each scene that is drawn by ``plot``, its arguments.
ARGUMENTS = {
    "basins": "",
    "basins-at-impact": "",
    "basins-clearance": "",
    "bouncing-ball": "--coordinate poincare_height --exact",
    "cascade": "--below lyapunov --dpi 200",
    "chatter": "--coordinate impact_v",
    "damping": "--dpi 220",
    "feigenbaum": "",
    "grazing": "",
    "grid": "--axis omega --at h=0.1 --at R=0.8",
    "hysteresis": "--exact",
    "impact-adding": "--coordinate impact_v",
    "inelastic-ball": "--coordinate impact_v --exact",
    "integrity": "--kind integrity --at omega=2.6 --dpi 200",
    "joint-clearance": "--exact --below impulse",
    "paper-dissipative-reduced-step": "",
    "period-map": "--kind map --exact",
    "quickstart": "--dpi 220",
    "restitution": "--dpi 220",
    "shaker": "--exact --below impulse",
    "two-periods-near-resonance": "--kind map --exact",
    "unstable-skeleton": "--exact --most 61",
    "vibrating-table": "--kind map --exact",
}
#: Pictures of benches, which take no sweep, and that of a script.
BENCHES = ("paper", "stability")
SCRIPT = "tolerances"


def words_of(figure):
    """Return the title of a figure, the labels of its panels, and the entries of its legends."""
    labels = []
    for panel in figure.axes:
        texts = (panel.get_title("left"), panel.get_title(), panel.get_xlabel(), panel.get_ylabel())
        labels += filter(None, texts)
    legends = [*figure.legends, *(panel.get_legend() for panel in figure.axes)]
    legends = [legend for legend in legends if legend is not None]
    return {
        "title": figure.get_suptitle().replace("\N{NO-BREAK SPACE}", " "),
        "labels": sorted({label.replace("\N{NO-BREAK SPACE}", " ") for label in labels}),
        "legend": [legend.get_title().get_text() for legend in legends]
        + [text.get_text() for legend in legends for text in legend.get_texts()],
    }


def drawn(name, *overrides, exact=True):
    """Run a scene in the working folder, draw NAME.png, and return the words in it."""
    sets = [word for override in overrides for word in ("--set", override)]
    file, kept = f"{name}.h5", []
    accepted("run", CONFIGS / f"{name}.yaml", *sets, "-o", file, "--quiet", "--overwrite")
    arguments = ARGUMENTS[name] if exact else re.sub(r"--exact|--most \d+", "", ARGUMENTS[name])

    def save(figure, *about):
        kept.append(figure)
        write(figure, *about)

    with patch("sweeps.plotting.api.save", save):
        accepted("plot", file, *arguments.split(), "-o", f"{name}.png")
    return words_of(kept[0])


def _scripted():
    """Draw the picture of a script of configs/ in the working folder, and return its words."""
    accepted("run", CONFIGS / f"{SCRIPT}.yaml", "-o", f"{SCRIPT}.h5", "--quiet", "--overwrite")
    spec = importlib.util.spec_from_file_location(SCRIPT, CONFIGS / f"{SCRIPT}_picture.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    with open_sweep(f"{SCRIPT}.h5") as dataset:
        figure = script.draw(dataset)
        figure.savefig(f"{SCRIPT}.png", dpi=200)
    return words_of(figure)


def digest(path):
    """Return the checksum of a picture."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def without_numbers(text):
    """Return a text without its numbers, and without the prefixes of metres."""
    text = re.sub("\\[[mn\N{MICRO SIGN}](?=m)", "[", text)
    return re.sub(r"[-+]?\d[\d.,]*(\^\{?-?\d+\}?)?", "#", text)


def main():
    """Draw the pictures with the given names, or all."""
    known = json.loads(WORDS.read_text()) if WORDS.exists() else {}
    chosen = sys.argv[1:] or [*ARGUMENTS, SCRIPT, *BENCHES]
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name in chosen:
            picture = Path(f"{name}.png")
            if name in ARGUMENTS:
                words = drawn(name)
            elif name == SCRIPT:
                words = _scripted()
            else:
                accepted("bench", name, "-o", picture)
                words = {}
            shutil.copy(picture, PICTURES)
            known[name] = {"sha256": digest(picture), **words}
            WORDS.write_text(json.dumps(dict(sorted(known.items())), indent=1) + "\n")
            print(name, flush=True)


if __name__ == "__main__":
    main()

"""Try versions of numba: the way in which each is used, its digest, and its speed.

    python .ci/numba_versions.py [VERSION ...]

Each version, such as ``0.61`` or ``newest``, is installed in a virtual environment of its own; by
default all that were tried, and the newest. ``private``, ``options`` or ``plain`` after a colon
takes that way, as in ``0.68:plain``. The command ends with 1 if a version fails, or if one gives
another digest of the quickstart's data. The speed is that of exact impacts, in forcing periods per
step of a scalar kernel that the same version compiled; rounds of both alternate.
"""

import os
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Prints the exact version, the way, forcing periods per second and per step of the scalar kernel.
SPEED = """
import time
import numba
import numpy as np
from limits import STEPS, yardstick
from vibroimpact import Oscillator, integrate
from vibroimpact.jit import WAY

points = Oscillator(h=0.1, R=0.8, omega=0.8, f=1.0).at().repeat(2048)
points["omega"] = np.linspace(0.8, 4.0, points.size)
best = {}
for _ in range(15):
    for work in (yardstick, lambda: integrate(points, transient=200, periods=100, threads=1)):
        begin = time.process_time()
        work()
        spent = time.process_time() - begin
        name = "scalar" if work is yardstick else "exact"
        best[name] = min(spent, best.get(name, spent))
rate = 300 * points.size / best["exact"]
print(numba.__version__, WAY.name, rate, rate * best["scalar"] / STEPS)
"""


def tried() -> list[str]:
    """Return the versions that the package says were tried."""
    text = (ROOT / "vibroimpact/jit/way.py").read_text(encoding="utf-8")
    found = re.search(r"^TRIED = \((.*)\)$", text, re.MULTILINE)
    assert found is not None
    return re.findall(r'"(.*?)"', found[1])


def measured(version: str, way: str, folder: Path) -> tuple[list[str], str]:
    """Return what a version prints for `SPEED`, and its digest of the quickstart's data."""
    venv.create(folder, with_pip=True)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    wanted = "numba" if version == "newest" else f"numba=={version}.*"
    subprocess.run([scripts / "python", "-m", "pip", "install", "-q", wanted, ROOT], check=True)
    environment = os.environ | {
        "PYTHONPATH": str(ROOT / "tests/benchmarks"),
        "NUMBA_CACHE_DIR": str(folder / "cache"),
    }
    if way:
        environment["VIBROIMPACT_NUMBA_HOOKS"] = way

    def output(*arguments: str | Path) -> str:
        return subprocess.run(
            [scripts / "python", *arguments],
            env=environment,
            cwd=folder,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        ).stdout

    speed = output("-c", SPEED).split()
    return speed, output(ROOT / ".ci/commands.py", folder, "--first").strip()


def main(versions: list[str]) -> int:
    """Print a row for each version; return the exit code."""
    digests = set()
    failed = False
    print("numba    way      million periods/s  periods/scalar step  digest", flush=True)
    for asked in versions:
        version, _, way = asked.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            try:
                (exact, used, rate, ratio), digest = measured(version, way, Path(folder))
            except subprocess.CalledProcessError as error:
                print(f"{asked:8} failed: {error}", flush=True)
                failed = True
                continue
        digests.add(digest)
        print(
            f"{exact:8} {used:8} {1e-6 * float(rate):17.1f}  {float(ratio):19.2f}  {digest[:12]}",
            flush=True,
        )
    if len(digests) > 1:
        print("the digests differ")
    return int(failed or len(digests) > 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or [*tried(), "newest"]))

"""The commands of a new user, in a new folder, with no compiled code kept from before.

    python .ci/commands.py VENV [--first]

Each command ends with 0 and leaves its file; with ``--first`` only the first run is done. The
output is the digest of the quickstart's data.
"""

import os
import signal
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Callable
from pathlib import Path

DIGEST = Path(__file__).absolute().with_name("digest.py")


def others(run: Callable[..., None], vibroimpact: str) -> None:
    """Run what follows the first run."""
    run("plot", "quickstart.h5", leaves="quickstart.png")
    exact = ("--exact", "--classes", "1/1")
    run("plot", "quickstart.h5", *exact, "-o", "exact.png", leaves="exact.png")
    run("info", "quickstart.h5")
    run("export", "quickstart.h5", "-o", "points.csv", leaves="points.csv")
    run("zoom", "quickstart.h5", "omega=2.7:2.8", "-o", "zoom.h5", leaves="zoom.h5")
    run("init", "basins", leaves="basins.yaml")
    few = ("--set", "start.x0.num=20", "--set", "start.v0.num=20")
    run("run", "basins.yaml", "--quiet", *few, "-o", "basins.h5", leaves="basins.h5")
    run("attractors", "basins.h5", "--csv", "attractors.csv", leaves="attractors.csv")
    run("run", "quickstart.yaml", "--quiet", "--dask", "local:2", "-o", "c.h5", leaves="c.h5")
    explore = [vibroimpact, "explore", "--no-browser"]
    with subprocess.Popen(explore, stdout=subprocess.PIPE, text=True) as page:
        try:
            assert page.stdout is not None
            urllib.request.urlopen(page.stdout.readline().strip()).close()
            if os.name != "nt":  # which has no such signal for one process
                page.send_signal(signal.SIGINT)
                if page.wait(60) != 0:
                    sys.exit("explore did not end with 0")
        finally:
            page.kill()


def main(venv: Path) -> None:
    """Run the commands with a virtual environment, and print the digest."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in a background job of a shell
        signal.signal(signal.SIGINT, signal.default_int_handler)  # which the commands inherit
    scripts = venv.absolute() / ("Scripts" if os.name == "nt" else "bin")
    python, vibroimpact = str(scripts / "python"), str(scripts / "vibroimpact")
    with tempfile.TemporaryDirectory() as work:
        os.chdir(work)
        os.environ["NUMBA_CACHE_DIR"] = str(Path(work).absolute() / "cache")

        def run(*arguments: str, leaves: str = "") -> None:
            done = subprocess.run([vibroimpact, *arguments], stdout=subprocess.DEVNULL, check=True)
            if leaves and not Path(leaves).stat().st_size:
                sys.exit(f"{done.args} ended with 0 and left an empty {leaves}")

        run("init", leaves="quickstart.yaml")
        run("run", "quickstart.yaml", "--quiet", leaves="quickstart.h5")
        if len(sys.argv) == 2:
            others(run, vibroimpact)
        files = sorted(Path().glob("[qc]*.h5"))  # the workers of a cluster compute the same numbers
        sys.exit(subprocess.run([python, DIGEST, *files]).returncode)


if __name__ == "__main__":
    main(Path(sys.argv[1]))

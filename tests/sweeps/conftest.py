"""Fixtures: a folder for every test, and the sweeps and the cluster that test files share."""

import logging
import shutil
import signal
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

import matplotlib as mpl
import matplotlib.text
import pytest
from matplotlib.backends import backend_agg
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text

from sweeps import interrupts, open_sweep
from sweeps.attractor.knocks import Knock
from sweeps.config.loading import parse_config
from sweeps.plotting import canvas
from sweeps.store.writer import SweepWriter
from tests.helpers.clusters import WORKERS
from tests.helpers.commands import SMALL
from tests.helpers.configurations import OVER_STARTS
from tests.helpers.sweep_files import run_in
from tests.helpers.written_files import random_sweeps

#: What `cheap_pictures` does in place of the layout, and what `with_layout` does again.
NO_LAYOUT = {
    (ConstrainedLayoutEngine, "execute"): lambda self, figure: None,
    (canvas, "_thin_ticks"): lambda axis: None,
    (canvas.Picture, "add_title"): Figure.suptitle,
}
LAYOUT = {part: getattr(*part) for part in NO_LAYOUT}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    """Change to an empty folder, with the ``CONFIG`` of the test file as sweep.yaml."""
    monkeypatch.chdir(tmp_path)
    if hasattr(request.module, "CONFIG"):
        Path("sweep.yaml").write_text(request.module.CONFIG)
    return tmp_path


@pytest.fixture(autouse=True, scope="session")
def undisturbed(tmp_path_factory):
    """Estimate a run in a tenth of the usual time, and say of no work that it is slow.

    test_limits.py and test_progress.py test both. Orbits and knocks are kept in a folder of the
    tests, and those of the user are left alone.
    """
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sweeps.engine.estimate._TRIAL", 0.01)
        patch.setattr("sweeps.text.PATIENCE", 1e6)
        patch.setattr("sweeps.opened.result_cache.root", lambda: folder)
        yield


@pytest.fixture(autouse=True, scope="session")
def cheap_pictures():
    """Paint a quarter of the usual pixels, and lay nothing out, no title or ticks either.

    All pictures have one parser of formulas, which keeps all that it has read, not 50, and measure
    a text once, not once for each picture. Of the beginnings of a title, which all have formulas,
    only those that are about as long as a line are measured. `with_layout` lays pictures out. The
    configuration of a file is parsed once.
    """
    renderer_at = cache(partial(RendererAgg, 1, 1))
    measuring = matplotlib.text._get_text_metrics_function
    width_of_line = Text._get_rendered_text_width

    @cache
    def measured(text, font, ismath, dpi):
        return renderer_at(dpi).get_text_width_height_descent(text, font, ismath)

    def of_renderer(renderer):
        return measured if type(renderer) is RendererAgg else measuring(renderer)

    def width(self, text):
        words = text.split(" ")
        widths = [width_of_line(self, word) for word in (*words, "n n", "nn")]
        whole = sum(widths[:-2]) + (len(words) - 1) * (widths[-2] - widths[-1])
        near = abs(whole - self._get_wrap_line_width()) < 2 * len(words)  # each is rounded
        in_formula = any(word.count("$") % 2 for word in words)
        return width_of_line(self, text) if near or in_formula else whole

    @cache
    def of_grid(text, name, noun):
        return parse_config(text, name, noun, table={})

    def parsed(*about, table):
        return parse_config(*about, table=table) if table else of_grid(*about)

    with pytest.MonkeyPatch.context() as patch, mpl.rc_context({"savefig.dpi": 150}):
        patch.setattr("sweeps.opened.opened_sweep.parse_config", parsed)
        patch.setattr(matplotlib.text, "_get_text_metrics_function", of_renderer)
        patch.setattr(Text, "_get_rendered_text_width", width)
        parse = MathTextParser._parse_cached.__wrapped__
        patch.setattr(MathTextParser, "_parse_cached", cache(parse))
        patch.setattr(backend_agg, "MathTextParser", cache(MathTextParser))
        for part, without in NO_LAYOUT.items():
            patch.setattr(*part, without)
        yield


@pytest.fixture
def stop_after(monkeypatch):
    """Return a context manager that interrupts a run after `count` blocks of `size` points."""

    @contextmanager
    def stopping(count, size):
        write, written = SweepWriter.write, []

        def writing(self, block, results):
            write(self, block, results)
            written.append(block)
            if len(written) == count:
                raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(SweepWriter, "write", writing)
            patch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: size)
            yield

    return stopping


@pytest.fixture(scope="module")
def random_sweep(tmp_path_factory):
    """Return a function that writes a sweep of random numbers and opens it."""
    with random_sweeps(tmp_path_factory.mktemp("random")) as make:
        yield make


@pytest.fixture(scope="module")
def path(request, tmp_path_factory):
    """Run the ``SWEEP`` of the test file, or else its ``CONFIG``, and return the path."""
    configuration = getattr(request.module, "SWEEP", None) or request.module.CONFIG
    return run_in(tmp_path_factory.mktemp("sweep"), configuration)


@pytest.fixture(scope="module")
def files(request, tmp_path_factory):
    """Run the ``FILES`` of the test file, and return their folder."""
    folder = tmp_path_factory.mktemp("files")
    for name, text in request.module.FILES.items():
        run_in(folder, text, name=f"{name}.h5")
    return folder


@pytest.fixture(scope="module")
def loaded(files):
    """Return the data of the ``FILES`` of the test file by name, which tests only read."""
    return {path.stem: open_sweep(path).load() for path in files.glob("*.h5")}


@pytest.fixture(scope="module")
def dataset(path):
    """Return the data of `path`, which tests only read."""
    with open_sweep(path) as opened:
        yield opened.load()


@pytest.fixture(scope="session")
def computed_starts(tmp_path_factory):
    """Return a function that runs ``OVER_STARTS`` with overrides and opens the file."""
    folder, opened = tmp_path_factory.mktemp("runs"), {}

    def make(*overrides):
        if overrides not in opened:
            name = f"{len(opened)}.h5"
            opened[overrides] = open_sweep(run_in(folder, OVER_STARTS, *overrides, name=name))
        return opened[overrides]

    yield make
    for dataset in opened.values():
        dataset.close()


@pytest.fixture(scope="session")
def small_run(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("small"), SMALL)


@pytest.fixture
def small_file(folder, small_run):
    """Copy the file of a run of ``SMALL`` to the folder, as small.h5."""
    shutil.copy(small_run, "small.h5")


@pytest.fixture
def with_layout(cheap_pictures, monkeypatch):
    """Lay figures out, in a test of the places and sizes of their parts."""
    for part, whole in LAYOUT.items():
        monkeypatch.setattr(*part, whole)


@pytest.fixture
def unpainted(monkeypatch):
    """Save figures without painting them, where only names and messages matter."""
    monkeypatch.setattr(Figure, "savefig", lambda self, file, **_: file.write(b"painted"))


@pytest.fixture(scope="module")
def cluster():
    """Return a local Dask cluster."""
    from distributed import LocalCluster

    options = {"n_workers": WORKERS, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(**options, silence_logs=logging.CRITICAL) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def client(cluster):
    """Return a client of the cluster."""
    from distributed import Client

    with Client(cluster, set_as_default=False) as client:
        yield client


@pytest.fixture
def handlers(monkeypatch):
    """The state that the process of a command has from its start, and its handlers of signals."""
    monkeypatch.setattr(interrupts, "_came", False)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupts.listen()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def no_knocks(monkeypatch, tmp_path):
    """Seek no knock for a picture; return the list of the attractors for which one is wanted."""
    monkeypatch.setattr("sweeps.opened.result_cache.root", lambda: tmp_path / "kept")
    sought = []

    def worst(motions, home, limit):
        sought.append(home)
        return Knock()

    monkeypatch.setattr("sweeps.attractor.knocks._Attractors.worst", worst)
    return sought

"""Use from Python: public names, and the notebook, run cell by cell."""

import ast
import inspect
import json
import pydoc
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

import sweeps
import vibroimpact
from sweeps import plotting
from tests.helpers.places import CONFIGS
from vibroimpact import Status

PHYSICS = (
    "POINT OrbitError Oscillator PeriodicOrbit Status bifurcation_curve branch integrate "
    "one_impact_orbit periodic_orbit simulate __version__"
)
ENGINE = (
    "ConfigError Failed Refused StoreError attractors branches curves explore integrity knocks "
    "load_config open_sweep run_sweep __version__"
)


@pytest.mark.parametrize(
    ("package", "names"),
    [
        (vibroimpact, PHYSICS.split()),
        (sweeps, ENGINE.split()),
        (plotting, [name for name in plotting.__all__ if name != "KINDS"]),
    ],
)
def test_every_name_is_there_and_documented(package, names):
    for name in names:
        assert name in dir(package) or name == "__version__"
        one = getattr(package, name)
        assert not inspect.isroutine(one) or "Returns\n" in one.__doc__


@pytest.mark.parametrize("package", [vibroimpact, sweeps, plotting])
def test_no_public_name_is_that_of_a_module(package):
    """An import of the module would set the name, and lazy-loader before 0.6 leaves it so."""
    modules = {Path(path).stem for path in Path(package.__file__).parent.iterdir()}
    names = {name for name in dir(package) if not inspect.ismodule(getattr(package, name))}
    assert not modules & (names - {"__version__"})


def test_help_of_the_engine_is_a_screen_that_names_all_of_it():
    text = pydoc.plain(pydoc.render_doc(sweeps))
    assert text.count("\n") < 60
    for name in dir(sweeps):
        assert re.search(rf"`(sweeps\.)?{name}`", text), name
    assert not hasattr(sweeps, "__all__")  # the text would have the docstrings of all its names


def test_the_pictures_are_there_without_an_import_of_their_own():
    assert sweeps.__getattr__("plotting") is plotting


@pytest.mark.parametrize("package", [vibroimpact, sweeps, plotting])
def test_a_docstring_names_only_what_is_public(package):
    """A name in capitals is a constant of its package, or the status of a point."""
    public = {*dir(package), *Status.__members__}
    for name in dir(package):
        if inspect.ismodule(one := getattr(package, name)):
            continue
        texts = [inspect.getdoc(one) or ""]
        texts += [part.__doc__ or "" for part in vars(one).values()] if inspect.isclass(one) else []
        for constant in re.findall(r"`(?:\w+\.)*([A-Z]{3}[A-Z_]*)`", "\n".join(texts)):
            assert constant in public, f"{name}: {constant}"


def shown_by(cell, names):
    """Run a cell; return the value of its last line as a notebook does, or None."""
    *lines, last = ast.parse("".join(cell["source"])).body
    if not isinstance(last, ast.Expr):
        lines.append(last)
    exec(compile(ast.Module(lines, []), cell["id"], "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
    return None


@pytest.mark.slow
def test_the_notebook_shows_a_bar_and_every_figure_once(monkeypatch, capsys):
    scene = (CONFIGS / "quickstart.yaml").read_text()
    Path("quickstart.yaml").write_text(scene.replace("stop: 3.5", "stop: 2.81"))
    monkeypatch.setattr(plt, "show", lambda: None)
    notebook = json.loads((CONFIGS / "pictures.ipynb").read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in code)  # stripped
    names, shown = {}, {}
    for cell in code:
        value = shown_by(cell, names)
        # A notebook shows both the pyplot figures and the value of a cell.
        shown[cell["id"]] = [*map(plt.figure, plt.get_fignums()), *[value] * (value is not None)]
        plt.close("all")
    names["sweep"].close()
    names["page"].close()
    assert "points" in capsys.readouterr().err
    (exact,), (means,), (page,) = (shown[name] for name in ("table", "data", "live"))
    first = exact[exact["kind"] == "flip"].iloc[0]
    assert first["value"] == pytest.approx(2.6589, abs=5e-5) and first["after"] == "2/2"
    middle = vibroimpact.Oscillator(h=0.05, R=0.8, omega=float(means.index[0].mid), f=1.0)
    impulse = 1.8 * vibroimpact.one_impact_orbit(middle).v  # in closed form
    assert len(means) == 10 and means.iloc[0] == pytest.approx(impulse, rel=0.01)
    assert page._repr_html_().startswith("<iframe")
    for name in ("diagram", "trajectory", "panels", "exact"):
        assert len(shown[name]) == 1 and isinstance(shown[name][0], Figure), name
        assert shown[name][0].axes, name

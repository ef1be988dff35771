"""The examples in the docstrings of all public names, as a reader would type them."""

import doctest
import inspect
import re
import sys
from types import FunctionType, ModuleType

import pytest

import sweeps
import sweeps.plotting
import vibroimpact
from tests.helpers.places import CONFIGS

#: Methods that only the packages call.
INTERNAL = {"set_limits", "fit_ordinate", "parameters", "model_post_init"}


def public(package: ModuleType) -> dict[str, object]:
    """Return the public functions and classes of a package, and the classes' own public methods."""
    found: dict[str, object] = {}
    for name in dir(package):
        value = getattr(package, name)
        if name.startswith("_") or isinstance(value, ModuleType) or not callable(value):
            continue
        if inspect.isclass(value) and issubclass(value, Exception):
            continue
        found[f"{package.__name__}.{name}"] = value
        if inspect.isclass(value):
            found |= {
                f"{package.__name__}.{name}.{method}": inspect.unwrap(getattr(value, method))
                for method, own in vars(value).items()
                if isinstance(own, FunctionType | classmethod)
                if not method.startswith("_") and method not in INTERNAL
            }
    return found


EVERY = public(vibroimpact) | public(sweeps) | public(sweeps.plotting)


#: How an example says from which other one it goes on: it uses a file of that one, or a name.
GOES_ON = re.compile(r"# of the example of `([\w.]+)`$", re.MULTILINE)


def run_example(name: str, names: dict[str, object]) -> dict[str, object]:
    """Run the example of a public name, with the names of another; return those that it leaves."""
    value = EVERY[name]
    text = inspect.getdoc(value) or ""
    known = vars(sys.modules[value.__module__]) | names
    example = doctest.DocTestParser().get_doctest(text, known, name, None, None)
    assert example.examples, "there is no example"
    runner = doctest.DocTestRunner()
    told: list[str] = []
    runner.run(example, out=told.append, clear_globs=False)
    assert not runner.failures, "".join(told)
    return {key: left for key, left in example.globs.items() if key not in known}


@pytest.fixture(scope="session")
def first(tmp_path_factory):
    """Return a folder with the files of the examples from which others go on, and their names."""
    folder = tmp_path_factory.mktemp("examples")
    sources = {name for value in EVERY.values() for name in GOES_ON.findall(value.__doc__ or "")}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, {name: run_example(f"sweeps.{name}", {}) for name in sources}


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_its_example_gives_what_it_says(name, first, monkeypatch):
    folder, names = first
    monkeypatch.chdir(folder)
    (source,) = GOES_ON.findall(EVERY[name].__doc__ or "") or [None]
    run_example(name, names.get(source, {}))


@pytest.mark.parametrize("package", [vibroimpact, sweeps], ids=["vibroimpact", "sweeps"])
def test_the_page_of_functions_names_everything_public(package):
    page = (CONFIGS / "python.md").read_text(encoding="utf-8")
    names = set(dir(package)) | (set(dir(sweeps.plotting)) if package is sweeps else set())
    unnamed = [
        name
        for name in names
        if not name.startswith("_") and not isinstance(getattr(package, name, None), ModuleType)
        if not re.search(rf"`(plotting\.)?{name}\b", page)
    ]
    assert unnamed == []

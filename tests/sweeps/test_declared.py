"""What pyproject.toml declares is what the packages import."""

import re
import sys
import tomllib

from tests.helpers.file_tables import PAGES, ROOT, imported, parsed

#: Packages whose versions another one of those declared chooses.
OF_OTHERS = {"cycler": "matplotlib", "llvmlite": "numba", "pydantic_core": "pydantic"}
#: Declared for another package, which imports it: xarray to open a sweep file, distributed to
#: encrypt its connections.
FOR_OTHERS = {"h5netcdf", "cryptography"}
#: Packages that are imported by another name than that of their distribution.
IMPORTED_AS = {"pillow": "PIL", "pyyaml": "yaml", "lazy-loader": "lazy_loader"}


def packages():
    """Return the names of all packages that files of the two packages import, stubs included."""
    paths = [path for package in PAGES for path in (ROOT / package).rglob("*.py")]
    found = {name.partition(".")[0] for path in paths for name in imported(parsed(path))}
    return found - sys.stdlib_module_names - {*PAGES}


def test_the_declared_packages_are_those_imported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    used = [key for key in extras if key not in ("test", "docs")]
    required = [*project["dependencies"], *(one for key in used for one in extras[key])]
    names = {re.match(r"[\w-]+", requirement)[0] for requirement in required}
    declared = {IMPORTED_AS.get(name, name) for name in names}
    assert {OF_OTHERS.get(name, name) for name in packages()} == declared - FOR_OTHERS

"""What pyproject.toml declares is what the packages import."""

import ast
import re
import sys
import tomllib

from tests.helpers.places import CONFIGS

ROOT = CONFIGS.parent
#: Packages whose versions another one of those declared chooses.
OF_OTHERS = {"cycler": "matplotlib", "llvmlite": "numba", "pydantic_core": "pydantic"}
#: Declared for another package, which imports it: xarray to open a sweep file, distributed to
#: encrypt its connections.
FOR_OTHERS = {"h5netcdf", "cryptography"}
#: Packages that are imported by another name than that of their distribution.
IMPORTED_AS = {"pillow": "PIL", "pyyaml": "yaml", "lazy-loader": "lazy_loader"}


def imported():
    """Return the names of all packages that files of the two packages import, stubs included."""
    found = set()
    for package in ("vibroimpact", "sweeps"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    found |= {name.name.partition(".")[0] for name in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    found.add(node.module.partition(".")[0])
    return found - sys.stdlib_module_names - {"vibroimpact", "sweeps"}


def test_the_declared_packages_are_those_imported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    used = [key for key in extras if key not in ("test", "docs")]
    required = [*project["dependencies"], *(one for key in used for one in extras[key])]
    names = {re.match(r"[\w-]+", requirement)[0] for requirement in required}
    declared = {IMPORTED_AS.get(name, name) for name in names}
    assert {OF_OTHERS.get(name, name) for name in imported()} == declared - FOR_OTHERS

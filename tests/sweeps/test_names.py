"""A name leads to one place: no two files share one, nor do two things that can leave theirs."""

import ast
from collections import Counter

from tests.helpers.file_tables import PAGES, ROOT, parsed

FILES = [
    path for package in PAGES for path in (ROOT / package).rglob("*.py") if path.stem != "__init__"
]
#: The function that measures basins, and the picture of what it measures; the sine and cosine at
#: the start of a step, in the rows of the kernel for either rule.
SHARED = {"integrity", "S_0", "C_0"}


def defined(path):
    """Return the names at the top of a file: its functions, classes and values."""
    found = set()
    for node in parsed(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [name for target in targets for name in ast.walk(target)]
            found |= {name.id for name in names if isinstance(name, ast.Name)}
    return found


def repeated(names):
    """Return the names that stand more than once."""
    return [name for name, count in Counter(names).items() if count > 1]


def test_no_two_files_have_the_same_name():
    assert len(FILES) > 100 and repeated(path.stem for path in FILES) == []


def test_a_name_that_can_leave_its_file_stands_in_no_other():
    names = [name for path in FILES for name in defined(path)]
    assert "run_sweep" in names and "POINT" in names
    assert {*repeated(name for name in names if not name.startswith("_"))} == SHARED

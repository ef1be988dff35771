"""The tables of files on the pages for developers: each file with the first line of its docstring.

``python -m tests.helpers.file_tables`` writes them again.
"""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: The page of each package.
PAGES = {package: ROOT / package / "README.md" for package in ("vibroimpact", "sweeps")}
BEGIN, END = "<!-- begin: the table of files -->\n", "<!-- end: the table of files -->"


def imported(tree):
    """Return the names of the modules that a module imports, also inside its functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def in_order(folder, trees):
    """Return the files of a folder so that each imports only files of the folder above it."""
    files = sorted(path for path in trees if path.parent == folder)
    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in files}
    uses = {
        path: sorted({modules[name] for name in imported(trees[path]) if name in modules} - {path})
        for path in files
    }
    return list(TopologicalSorter(uses).static_order())


def table(package):
    """Return the table of the files of a package, folder by folder."""
    root = ROOT / package
    paths = sorted(path for path in root.rglob("*.py") if not path.name.startswith("__init__"))
    trees = {path: ast.parse(path.read_text()) for path in paths}
    folders = sorted({path.parent for path in paths})
    rows = []
    for path in (path for folder in folders for path in in_order(folder, trees)):
        subject = ast.get_docstring(trees[path]).splitlines()[0]
        rows.append(f"| `{path.relative_to(root).as_posix()}` | {subject} |")
    return "\n".join(["| file | subject |", "| --- | --- |", *rows, ""])


def with_table(page, package):
    """Return the text of a page with the present table of its package."""
    pattern = re.compile(f"(?<={re.escape(BEGIN)}).*(?={re.escape(END)})", re.DOTALL)
    text, count = pattern.subn(lambda _: table(package), page.read_text())
    assert count == 1, f"{page} has no place for the table"
    return text


if __name__ == "__main__":
    for package, page in PAGES.items():
        page.write_text(with_table(page, package))

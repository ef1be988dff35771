"""The tables of files on the pages for developers: each file with the first line of its docstring.

``python -m tests.helpers.file_tables`` writes them again.
"""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: The page of each package.
PAGES = {package: ROOT / package / "README.md" for package in ("vibroimpact", "sweeps")}
BEGIN, END = "<!-- begin: the table of files -->\n", "<!-- end: the table of files -->"


@cache
def parsed(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text())


def imported(tree):
    """Return the names of the modules that a module imports, also inside its functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def in_order(nodes, imports, part_of):
    """Return folders or files so that each imports only those before it."""
    places = {path: path.parent if path.stem == "__init__" else path for path in imports}
    of_name = {
        ".".join(place.relative_to(ROOT).with_suffix("").parts): path
        for path, place in places.items()
    }
    uses = {node: set() for node in nodes}
    for path, modules in imports.items():
        names = sorted(of_name[name] for name in modules & of_name.keys())
        if part_of(path) in uses:
            uses[part_of(path)].update(map(part_of, names))
    uses = {node: sorted(used & uses.keys() - {node}) for node, used in uses.items()}
    return list(TopologicalSorter(uses).static_order())


def table(package):
    """Return the list of the files of a package, room by room."""
    root = ROOT / package
    sources = sorted(root.rglob("*.py"))
    imports = {path: {*imported(parsed(path))} for path in sources}
    paths = [path for path in imports if path.name != "__init__.py"]
    rooms = sorted({path.parent for path in paths} - {root})
    lines = []
    for room in (root, *in_order(rooms, imports, lambda path: path.parent)):
        files = [path for path in paths if path.parent == room]
        if room != root:
            lines.append(f"\n**`{room.name}/`** {subject(room / '__init__.py')}\n")
        lines += [f"- `{path.name}`: {subject(path)}" for path in in_order(files, imports, Path)]
    return "\n".join([*lines, ""])


def subject(path):
    """Return the first line of the docstring of a module."""
    return ast.get_docstring(parsed(path)).splitlines()[0]


def with_table(page, package):
    """Return the text of a page with the present table of its package."""
    pattern = re.compile(f"(?<={re.escape(BEGIN)}).*(?={re.escape(END)})", re.DOTALL)
    text, count = pattern.subn(lambda _: table(package), page.read_text())
    assert count == 1, f"{page} has no place for the table"
    return text


if __name__ == "__main__":
    for package, page in PAGES.items():
        page.write_text(with_table(page, package))

"""The pages say what is in every file, and where, and show every scene of the gallery."""

import io
import re
import subprocess
import tokenize
from functools import cache

import pytest

from tests.helpers.file_tables import PAGES, with_table
from tests.helpers.places import CONFIGS, ROOT

#: A word of code, or a key of a configuration.
WORD = re.compile(r"[A-Za-z_]\w*")


@cache
def tracked():
    """Return the paths of all files of the repository; an installation may lie beside them."""
    arguments = ["git", "ls-files"]
    listed = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True)
    return [path for path in listed.stdout.split("\n") if path and (ROOT / path).exists()]


@cache
def python_files():
    """Return, for each Python file, its comments and docstrings, and the words of its code."""
    files = {}
    for path in (path for path in tracked() if path.endswith((".py", ".pyi"))):
        prose, words = [], set()
        for token in tokenize.generate_tokens(io.StringIO((ROOT / path).read_text()).readline):
            text = token.string
            if token.type == tokenize.COMMENT or text.lstrip("rf").startswith('"""'):
                prose.append(text)
            elif token.type in (tokenize.NAME, tokenize.STRING):
                words.update(WORD.findall(text))
        files[path] = "\n".join(prose), words
    return files


@cache
def code():
    """Return all words of the code, and of the names of files."""
    known = {word for _, words in python_files().values() for word in words}
    return known | {word for path in tracked() for word in WORD.findall(path)}


def texts():
    """Return every text in which a file may be named: pages, settings, comments, docstrings."""
    endings = (".md", ".toml", ".yml", ".yaml", ".ipynb")
    whole = [path for path in tracked() if path.endswith(endings) and path != "CHANGELOG.md"]
    prose = {path: text for path, (text, _) in python_files().items()}
    return prose | {path: (ROOT / path).read_text() for path in whole}


def missing_files(text):
    """Return the Python files that a text names, but not the repository."""
    named = set(re.findall(r"(?<![\w.*<>/-])[\w./-]*\w\.pyi?\b", text))
    return {one for one in named if not any(f"/{path}".endswith(f"/{one}") for path in tracked())}


def missing_modules(text):
    """Return the dotted names of a text that are neither a module of this project nor in one."""
    found = set()
    for name in set(re.findall(r"\b(?:sweeps|vibroimpact|tests)(?:\.[a-z_]\w*)+", text)):
        parts = name.split(".")
        while not ((path := ROOT.joinpath(*parts)).is_dir() or path.with_suffix(".py").exists()):
            if parts.pop() not in code():
                found.add(name)
    return found


def missing_names(text):
    """Return the names in backticks, with an underscore or two capitals, that no code has."""
    names = set(re.findall(r"(?<!`)`{1,2}([A-Za-z_]\w*)(?:\(\))?`{1,2}(?!`)", text))
    return {name for name in names if re.search(r"_|[A-Z].*[A-Z]", name)} - code()


@pytest.mark.parametrize("package", PAGES)
def test_the_table_of_files_is_that_of_the_docstrings(package):
    """After a new file or docstring: python -m tests.helpers.file_tables."""
    page = PAGES[package]
    assert page.read_text() == with_table(page, package)


#: Names of other projects and of examples.
ELSEWHERE = {"heyoka.py", "//bluescarni.github.io/heyoka.py", "tests/sweeps/ROOM/test_FILE.py"}
#: Made while the code runs: an attribute of a file, columns of a table, a variable of Dask.
MADE = {"time_unit", "lyapunov_1", "lyapunov_2", "DASK_DISTRIBUTED__COMM__TLS__CA_FILE"}


@pytest.mark.slow
def test_what_pages_comments_and_docstrings_name_exists():
    """So that a file or function that is renamed is renamed everywhere."""
    found = {path: missing_files(text) | missing_modules(text) for path, text in texts().items()}
    for path, text in texts().items():
        if path.endswith((".py", ".md")):
            found[path] |= missing_names(text)
    assert {path: new for path, names in found.items() if (new := names - ELSEWHERE - MADE)} == {}


def test_a_name_that_is_gone_is_found():
    gone = "".join(["nowhere", "_to_be_found"])  # in two parts: no word of this file
    text = (
        f"`{gone}` of `step/{gone}.py`, sweeps.opened.{gone}; `finished_points` of `store/parts.py`"
    )
    assert missing_names(text) == {gone}
    assert missing_files(text) == {f"step/{gone}.py"}
    assert missing_modules(text) == {f"sweeps.opened.{gone}"}


def headings(page):
    """Return the anchors of a page, as GitHub makes them of its headings."""
    found = re.findall(r"^#+ (.+)$", (ROOT / page).read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in found}


@pytest.mark.parametrize(
    "page",
    [str(path.relative_to(ROOT)) for path in (*ROOT.glob("*.md"), *ROOT.glob("[a-z]*/*.md"))],
)
def test_every_link_within_the_repository_leads_somewhere(page):
    lost = []
    for link in re.findall(r"\]\(([^)\s]+)\)", (ROOT / page).read_text()):
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        if "://" not in link and not (
            target.exists() and (not anchor or anchor in headings(target))
        ):
            lost.append(link)
    assert lost == []


def test_every_scene_has_a_comment_and_is_in_the_gallery_with_its_picture():
    text = (CONFIGS / "README.md").read_text()
    scenes, pictures = list(CONFIGS.glob("*.yaml")), re.findall(r"\(pictures/([^)]+)\)", text)
    assert len(scenes) > 20 and len(pictures) > 20
    for path in scenes:
        assert path.read_text().startswith("# "), path
        assert f"`{path.stem.removesuffix('-reduced-step')}" in text, path
        if not path.stem.startswith("paper-"):
            assert f"(pictures/{path.stem}.png)" in text, path
    for name in pictures:
        limit = 1_500_000 if name.endswith(".gif") else 600_000
        assert (CONFIGS / "pictures" / name).stat().st_size < limit, name

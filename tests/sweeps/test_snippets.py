"""What the pages show is so: Python runs, YAML is valid, options exist, what is printed is printed.

A comment before a block of code says what is not on the page: ``<!-- needs FILE -->``, a file that
Python reads, and ``<!-- prints: COMMAND -->``, the command whose lines a block without a language
shows. In a block of a console the command stands after a dollar sign.
"""

import contextlib
import io
import re
import shlex
import shutil
from pathlib import Path

import pytest
from typer.main import get_command

from sweeps import load_config
from sweeps.cli.main import app
from tests.helpers.commands import accepted
from tests.helpers.gallery import ARGUMENTS
from tests.helpers.places import CONFIGS, ROOT
from tests.sweeps.test_pages import tracked

PAGES = [path for path in tracked() if path.endswith(".md") and path != "CHANGELOG.md"]
BLOCK = re.compile(
    r"(?:^ *<!-- *(?P<note>[^\n]*?) *-->\n+)?^(?P<indent> *)```(?P<kind>\w*)\n(?P<text>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)
#: The commands that make each file that a snippet needs, with few points.
FILES = {
    "hysteresis.h5": "vibroimpact run hysteresis.yaml --set oscillator.omega.num=60",
    "map.h5": "vibroimpact run period-map.yaml -o map.h5 --set oscillator.omega.num=8 "
    "--set oscillator.R.num=6",
    "R*.h5": "vibroimpact run quickstart.yaml --set oscillator.R=0.6 -o R6.h5 && "
    "vibroimpact run quickstart.yaml --set oscillator.R=0.8 -o R8.h5",
    "changes.csv": "vibroimpact run feigenbaum.yaml -o line.h5 && "
    "vibroimpact info line.h5 --bifurcations --csv changes.csv",
}
#: What no test has, so that the snippet is only compiled.
ELSEWHERE = {"a cluster"}


def blocks(page, *kinds):
    """Return the note and the text of each block of some languages, with the line of the page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [
        (found["note"] or "", re.sub(rf"(?m)^{found['indent']}", "", found["text"]), line)
        for found in BLOCK.finditer(text)
        if found["kind"] in kinds
        for line in [text.count("\n", 0, found.start("text"))]
    ]


def pages_with(*kinds):
    return pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, *kinds)])


@pytest.fixture(autouse=True)
def scenes(folder):
    """Put the scenes into the folder, as in a clone and as `vibroimpact init` writes them."""
    Path("configs").symlink_to(CONFIGS)
    for path in CONFIGS.glob("*.yaml"):
        shutil.copy(path, path.name)
    Path("table.csv").write_text("omega,R,serial\n2.5,0.8,a1\n2.6,0.7,a2\n")


@pytest.mark.slow
@pages_with("python")
def test_python_runs_in_the_order_of_the_page(page, unpainted):
    """Without names from elsewhere, and with the files that a comment names."""
    names = {"__name__": "page"}
    for note, text, line in blocks(page, "python"):
        code = compile("\n" * line + text, page, "exec")
        needed = note.removeprefix("needs ") if note.startswith("needs ") else ""
        if needed in ELSEWHERE:
            continue
        printed_by(FILES[needed] if needed else "")
        with contextlib.redirect_stdout(io.StringIO()):
            exec(code, names)


def printed_by(commands):
    """Run commands that are joined by &&, and return what the last one prints."""
    printed = ""
    for command in commands.split(" && ") if commands else ():
        program, *words = shlex.split(command)
        assert program == "vibroimpact", command
        printed = accepted(*words)
    return printed


def same_lines(text):
    """Return the lines of an output without times, which differ from run to run."""
    timeless = re.sub(r"\bin [\d.e+-]+ (s|min|h)\b", "in some time", text)
    return [" ".join(line.split()) for line in timeless.splitlines() if line.strip()]


@pytest.mark.slow
@pages_with("", "console", "text")
def test_what_a_page_says_is_printed_is_printed(page):
    for note, text, line in blocks(page, "", "console", "text"):
        if note.startswith("prints: "):
            text = f"$ {note.removeprefix('prints: ')}\n{text}"
        assert text.startswith("$ "), f"{page}, line {line}: which command prints this?"
        for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
            commands, _, shown = part.partition("\n")
            printed = same_lines(printed_by(commands))
            assert [one for one in same_lines(shown) if one not in printed] == [], printed


@pages_with("yaml")
def test_yaml_is_a_configuration(page):
    for _, text, _ in blocks(page, "yaml"):
        if not re.search("^jobs:", text, re.MULTILINE):  # of CI: cli/test_systems.py runs it
            Path("page.yaml").write_text(text)
            assert load_config("page.yaml").size


def commands_on(page):
    """Return the commands of the program on a page, in blocks and in the text."""
    text = (ROOT / page).read_text(encoding="utf-8").replace("\\\n", " ")
    inline = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    shown = [part.replace("\n", " ") for part in re.findall(r"`([^`]+)`", inline)]
    shown += [line.removeprefix("$ ") for line in text.splitlines()]
    shown = [part for whole in shown for part in re.split(r" && |\| |; ", whole)]
    return [one.partition("  #")[0] for one in shown if re.match(r"(\S*/)?vibroimpact [a-z]", one)]


def test_every_command_on_a_page_exists_with_its_options():
    known, checked = get_command(app), 0
    for page in PAGES:
        for shown in commands_on(page):
            group, words = known, shown.split()[1:]
            while words and hasattr(group, "commands"):
                name = words.pop(0)
                assert name in group.commands, f"{page}: {shown}"
                group = group.commands[name]
            options = {name for parameter in group.params for name in parameter.opts} | {"--help"}
            given = re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", " ".join(words))
            assert {*given} <= options, f"{page}: {shown}"
            checked += 1
    assert checked > 40


def test_the_help_of_a_command_names_only_its_own_options():
    for name, command in get_command(app).commands.items():
        helps = " ".join(getattr(parameter, "help", None) or "" for parameter in command.params)
        options = {option for parameter in command.params for option in parameter.opts}
        assert {*re.findall(r"(?<![\w-])--[a-z][\w-]*", helps)} <= options, name


def test_the_gallery_shows_the_options_that_drew_its_pictures():
    text = (ROOT / "configs/README.md").read_text(encoding="utf-8")
    shown = dict(re.findall(r"^`([\w-]+)`(?:, `([^`]+)`)?", text, re.MULTILINE))
    drawn = {name: re.sub(r" ?--dpi \d+", "", given) for name, given in ARGUMENTS.items()}
    assert {name: shown[name] for name in drawn} == drawn

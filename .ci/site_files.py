"""The files of the site that ``mkdocs.yml`` describes: those of the repository, where they stand.

mkdocs takes its pages from a folder that lies beside its configuration. The pages of this
repository lie beside the code, and link to files there, so all files that git tracks are taken.
"""

import re
import subprocess
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).absolute().parents[1]
#: On a narrow screen a wide table scrolls by itself, not the page.
STYLE = "table {display: block; overflow-x: auto}"


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Return the files that git tracks, and a page for the public names of each package."""
    listed = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True)
    here = [path for path in listed.splitlines() if (ROOT / path).is_file()]
    taken = [File.generated(config, path, abs_src_path=str(ROOT / path)) for path in here]
    pages = {"sweeps": ["sweeps", "sweeps.plotting"], "vibroimpact": ["vibroimpact"]}
    for package, modules in pages.items():
        text = "\n".join(functions(module) for module in modules)
        taken.append(File.generated(config, f"{package}/functions.md", content=text))
    taken.append(File.generated(config, "site.css", content=STYLE))
    return Files([file for file in files if file.src_dir != config.docs_dir] + taken)


def functions(module: str) -> str:
    """Return a page with the names that the stub of a package exports."""
    stub = (ROOT.joinpath(*module.split(".")) / "__init__.pyi").read_text()
    names = [line.split()[-1] for line in stub.splitlines() if re.match(r"from \.\w.* as ", line)]
    return "\n\n".join([f"# {module}", *(f"::: {module}.{name}" for name in names)])

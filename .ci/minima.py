"""Print the least versions that pyproject.toml allows, as a file of constraints for pip."""

import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
for requirement in [*project["dependencies"], *extras["explore"], *extras["distributed"]]:
    print(requirement.replace(">=", "=="))

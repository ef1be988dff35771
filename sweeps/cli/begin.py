"""The commands ``init`` and ``schema``, for writing a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sweeps.cli.terminal import say
from sweeps.errors import Refused
from sweeps.text import nearest, suggestion


def init(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="The name of a scene of the gallery.")
    ] = "quickstart",
) -> None:
    """Write the configuration of a scene, with comments, into the folder: SCENE.yaml."""
    from sweeps.config.scenes import scenes
    from sweeps.store.replacing import check_target, writing

    texts = scenes()
    if scene not in texts:
        raise Refused(
            f"there is no scene {scene!r}{suggestion(nearest(scene, texts))}; "
            f"expected: {', '.join(texts)}"
        )
    path = Path(f"{scene}.yaml")
    if check_target(path, "configuration"):
        raise Refused(f"{path} exists, and is left as it is; remove it, or rename it")
    with writing(path, "configuration") as new:
        new.write_text(texts[scene], encoding="utf-8")
    say(path)
    say(f"next: vibroimpact run {path}")


def schema() -> None:
    """Show the JSON schema of a sweep's configuration, for editors."""
    import json

    from sweeps.config.sweep import json_schema

    say(json.dumps(json_schema(), indent=2))

"""Writing a figure: which files are allowed, what they say of themselves, and a whole file."""

from __future__ import annotations

import os
import warnings
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from sweeps.analysis.selection import listed
from sweeps.errors import Failed, Refused

#: Of each format, the fields for a title, the program and a text.
_FIELDS = {
    "png": ("Title", "Software", "Description"),
    "svg": ("Title", "Creator", "Description"),
    "pdf": ("Title", "Creator", "Subject"),
}
#: The same picture gives the same bytes at any time.
_NO_DATES = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
FORMATS = tuple(_FIELDS)


def description(dataset: xr.Dataset, command: str) -> tuple[str, str, str]:
    """Return title, program and text for the metadata of a picture of an opened sweep.

    The command is that which draws it, ``""`` where it is none.
    """
    try:
        version = metadata.version("vibroimpact")
    except metadata.PackageNotFoundError:
        version = "from a checkout"
    about = {
        name.removesuffix("_version"): value
        for name, value in dataset.attrs.items()
        if name.endswith("_version") or name == "numerics"
    }
    text = "computed with " + ", ".join(f"{name} {value}" for name, value in about.items())
    text += f"\ncommand: {command}" if command else ""
    text += f"\nconfiguration:\n{dataset.attrs['configuration']}"
    program = f"vibroimpact {version}, matplotlib {mpl.__version__}"
    return str(dataset.attrs["name"]), program, text


def check_picture(output: Path) -> None:
    """Refuse a path that no picture can be written to.

    Raises
    ------
    Refused
        If its ending is none of ``FORMATS``, or its folder does not exist.
    """
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise Refused(f"{output} must end in one of {listed('.' + f for f in FORMATS)}")
    if not os.path.isdir(output.parent):  # which, unlike Path.is_dir(), never raises
        raise Refused(f"the folder {output.parent} of the picture {output.name} does not exist")
    if os.path.isdir(output):
        raise Refused(f"{output} is a directory; give -o the name of a file")


def save(figure: Figure, output: Path, description: tuple[str, ...] = ()) -> None:
    """Write a figure, with its `description` as metadata, to a draft that then replaces `output`.

    Raises
    ------
    Failed
        If it cannot be written.
    """
    target = Path(os.path.realpath(output))  # resolve() raises where links make a loop
    draft = target.with_name(f".picture-{os.getpid()}{output.suffix}")
    kind = output.suffix.lower().lstrip(".")
    about = dict(zip(_FIELDS[kind], description, strict=False))
    try:
        with warnings.catch_warnings():
            # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            figure.savefig(draft, metadata={**about, **_NO_DATES[kind]})
        os.replace(draft, target)
    except OSError as error:
        raise Failed(f"{output} cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # which must not hide why there is none
            draft.unlink()

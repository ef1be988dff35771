"""Writing a figure: which files are allowed, what they say of themselves, and a whole file."""

from __future__ import annotations

import os
import warnings
from importlib import metadata
from pathlib import Path

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from sweeps.analysis.selection import listed
from sweeps.errors import Refused
from sweeps.store.replacing import check_target, replacing

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


def check_picture(output: Path, data: str | Path = "") -> None:
    """Refuse a path that no picture can be written to.

    Parameters
    ----------
    output : Path
    data : str or Path, optional
        The file that is drawn.

    Raises
    ------
    Refused
        If it is the file that is drawn, its ending is none of ``FORMATS``, or no file can be there.
    """
    if os.path.isfile(data) and os.path.exists(output) and os.path.samefile(output, data):
        raise Refused(f"the picture {output} would replace the data; give -o another file")
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise Refused(f"{output} must end in one of {listed('.' + f for f in FORMATS)}")
    check_target(output, "picture")


def save(figure: Figure, output: Path, description: tuple[str, ...] = ()) -> None:
    """Write a figure, with its `description` as metadata, to a file, whole or not at all.

    Raises
    ------
    Refused, Failed
        If it cannot be written there, as from `replacing`.
    """
    kind = output.suffix.lower().lstrip(".")
    about = dict(zip(_FIELDS[kind], description, strict=False))
    with replacing(output, "picture") as draft, warnings.catch_warnings():
        # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        figure.savefig(draft, format=kind, metadata={**about, **_NO_DATES[kind]})

"""`plot`: each `Kind` of picture or animation by name, written to a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from sweeps import plotting
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.doors import takes_sweep
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.plotting.page import PAGE, PICTURE_ARGUMENTS, Page
from sweeps.plotting.saving import ANIMATED, check_picture, description, save
from sweeps.plotting.style import in_style
from sweeps.store.variables import DIRECTION
from sweeps.text import choice_of, listed, near_misses, suggestion
from vibroimpact.inputs import PATH, TEXT


class Kind(NamedTuple):
    """A kind of picture."""

    function: str  # of this room, which is imported when it draws: some need the compiler
    options: tuple[str, ...] = ()  # of the function, other than `at`
    axes: int = 0  # number of axes that it chooses if not given, besides those shown always
    implied: tuple[str, ...] = ()  # axes that it always shows

    def draw(self, *arguments: Any, **options: Any) -> Figure:
        """Draw a picture of the kind."""
        figure: Figure = getattr(plotting, self.function)(*arguments, **options)
        return figure


#: The pictures by name.
KINDS: Mapping[str, Kind] = {
    "bifurcation": Kind(
        "bifurcation",
        ("axes", "coordinate", "exact", "below", "color", "overlay"),
        axes=1,
        implied=(DIRECTION,),
    ),
    "attractors": Kind("attractor_diagram", ("axes", "coordinate"), axes=1, implied=START_AXES),
    "basins": Kind("basins", ("beside",), implied=STARTS),
    "integrity": Kind("integrity", ("panels",), implied=("x0", "v0")),
    "map": Kind("parameter_map", ("axes", "quantity", "exact", "overlay"), axes=2),
    "section": Kind("section", ("color",)),
    "impacts": Kind("impacts", ("color",)),
    "trajectory": Kind("trajectory", ("periods", "color", "fps")),
    "table": Kind(
        "table_panels", ("axes", "quantity", "color", "overlay", "panels"), implied=(TABLE,)
    ),
}


@takes_sweep({**PICTURE_ARGUMENTS, "kind": TEXT, "output": PATH})
def plot(
    sweep: OpenedSweep,
    output: str | Path,
    kind: str | None = None,
    at: Selection | None = None,
    *,
    page: Page = PAGE,
    command: str = "",
    **options: Any,
) -> Path:
    """Draw a picture of an opened sweep and write it to a file.

    The metadata of the picture contain the versions, the numerics and the configuration.

    Parameters
    ----------
    sweep : Dataset
        From `sweeps.open_sweep`.
    output : str or Path
        The picture; its ending must be .png, .svg, .pdf, .eps, .tiff or .tif, or for an animation
        of a `trajectory` .gif or .mp4, which needs the program ffmpeg.
    kind : str, optional
        One of ``KINDS``, by default the result of `default_kind`.
    at : mapping of str to float, optional
        Values of the swept axes that are not drawn. The nearest grid value is used; the default is
        the first. If an axis was followed up and down, ``direction`` selects one direction; by
        default a `bifurcation` without a color and `attractors` show both, and other pictures show
        the first.
    page : Page, optional
        Size, title and limits.
    command : str
        The command that draws the picture, for its metadata.
    **options
        Those of the kind, as ``KINDS[kind].options`` lists them: ``color`` of `bifurcation`, or
        ``fps`` of `animate`. With None the picture chooses.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    Refused
        If the request does not fit the file, or the picture cannot be written to `output`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.plot(ds, "flip.png").name
    'flip.png'
    """
    output = Path(output)
    read = [str(sweep.data.encoding.get("source", "")), options.get("overlay")]
    check_picture(output, *(file for file in read if isinstance(file, str | Path)), animated=True)
    options = {name: value for name, value in options.items() if value is not None}
    kind = default_kind(sweep, at, **options) if kind is None else kind
    check_options(kind, options, output)
    about = description(sweep.attrs, command)
    with in_style({} if page.dpi is None else {"savefig.dpi": page.dpi}):
        if is_animated(output):
            from sweeps.plotting.animation import save_animation

            save_animation(sweep, output, about, at=at, page=page, **options)
        else:
            save(KINDS[kind].draw(sweep, at=at, page=page, **options), output, about)
    return output


def is_animated(output: Path) -> bool:
    """Whether a picture is an animation, by its ending."""
    return output.suffix.lower() in ANIMATED


def check_options(kind: str, options: Iterable[str], output: Path) -> None:
    """Refuse a kind that is no picture, and options that it or the kind of file does not take."""
    check_kind(kind)
    if is_animated(output) and (kind != "trajectory" or "color" in options):
        several = f"the picture {kind}" if kind != "trajectory" else "several motions"
        raise Refused(
            f"{output} is not allowed for {several}; expected: the motion of one point, with the "
            f"picture trajectory and without color, or an ending of a picture, as .png"
        )
    if "fps" in options and not is_animated(output):
        raise Refused(f"fps is only for an output that ends in {' or '.join(ANIMATED)}")
    for option in options:
        kinds = [name for name, taker in KINDS.items() if option in taker.options]
        if not kinds:
            every = dict.fromkeys(name for taker in KINDS.values() for name in taker.options)
            meant = suggestion(near_misses(option, every))
            raise Refused(f"there is no option {option}{meant}; {choice_of(every)}")
        if kind not in kinds:
            other = "; a diagram shows it as color or below" if option == "quantity" else ""
            raise Refused(
                f"{option} can be chosen for {' or '.join(kinds)} only, not for {kind}{other}"
            )


def check_kind(kind: str) -> None:
    """Refuse a name that is not a kind of picture."""
    if kind not in KINDS:
        meant = suggestion(near_misses(kind, KINDS))
        raise Refused(f"there is no picture {kind!r}{meant}; choose one of {listed(KINDS)}")


def default_kind(sweep: OpenedSweep, at: Selection | None = None, **options: Any) -> str:
    """Return the kind of picture that shows most of a sweep; the arguments are those of `plot`.

    The first case that applies counts:

    - for a table ``table``, or ``trajectory`` if a row, `periods` or `fps` are given;
    - with a `quantity` ``map``, and with `periods` or `fps` ``trajectory``;
    - if x0, v0 or phase was swept and the period recorded: ``attractors`` if a parameter was swept,
      too, and no start chosen, ``basins`` if only starts were, and two of them are not chosen;
    - if two parameters were swept, the period recorded, and neither chosen: ``map``;
    - if an axis was swept ``bifurcation``;
    - if a trajectory was recorded ``trajectory``, else ``section``.
    """
    if TABLE in sweep.grid:
        return "trajectory" if at or {"periods", "fps"} & options.keys() else "table"
    for option, kind in (("quantity", "map"), ("periods", "trajectory"), ("fps", "trajectory")):
        if option in options:
            return kind
    axes = sweep.axes
    chosen = {*(at or {}), *options.get("axes", ())} - {DIRECTION}
    starts = {*STARTS} & {*axes}
    if starts and "period" in sweep and not {"exact", "below", "color"} & options.keys():
        if {*axes} - {*START_AXES}:
            if not starts & chosen:
                return "attractors"
        elif len(starts - chosen) == 2 and not options.keys() - {"overlay"}:
            return "basins"
    only_adds = options.keys() <= {"exact", "overlay"}
    both = len(axes) == 2 and all(sweep.sizes[name] > 1 for name in axes)
    if both and "period" in sweep and not starts and not chosen and only_adds:
        return "map"
    if axes:
        return "bifurcation"
    return "trajectory" if "trajectory_x" in sweep else "section"


def silent_cuts(
    sweep: OpenedSweep,
    kind: str,
    at: Selection | None = None,
    axes: Sequence[str] = (),
    color: str | None = None,
) -> dict[str, float | str]:
    """Return the swept axes that a picture cuts without being asked, with their first values."""
    implied = {*KINDS[kind].implied}
    if color is not None:
        implied |= set() if KINDS[kind].axes else {*sweep.axes}  # sections of all points
        implied = implied - {DIRECTION} | {DIRECTION} & {color}
    fixed = {*implied, *(at or {}), *axes}
    remaining = [name for name in sweep.grid if name not in fixed and sweep.sizes[name] > 1]
    axes_left = [name for name in remaining if name != DIRECTION]
    longest = sorted(axes_left, key=lambda name: -sweep.sizes[name])
    default_axes = longest[: max(0, KINDS[kind].axes - len(axes))]
    return {name: sweep[name][0].item() for name in remaining if name not in default_axes}

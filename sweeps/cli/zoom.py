"""The command ``zoom``: a piece of an axis, computed and drawn."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sweeps.cli import common, plot, run
from sweeps.errors import Refused
from sweeps.interrupts import raised_at_once
from sweeps.text import fewest_digits, near_misses, suggestion
from vibroimpact.inputs import refusal

if TYPE_CHECKING:
    from sweeps.config.sweep import SweepConfig
    from sweeps.opened.opened_sweep import OpenedSweep
    from sweeps.plotting.page import Limits, Page

_NUMBER = r"-?[0-9.]+(?:e[-+]?[0-9]+)?"


def zoom_command(
    file: Path = common.SWEEP_FILE,
    pieces: list[str] = common.argument(
        "NAME=LOW:HIGH...",
        "The range of each axis to compute, e.g. omega=2.71:2.76. For a coordinate, e.g. "
        "poincare_x=-1:0, the range that is drawn.",
    ),
    output: Path | None = common.option(
        "OUT.h5",
        "The file to write, with the picture beside it; OUT-NAME-LOW-HIGH.h5 if not given.",
        "-o",
        "--output",
    ),
    overrides: list[str] = run.OVERRIDES,
    coordinate: str | None = plot.COORDINATE,
    width: str | None = plot.PAGE_WIDTH,
    title: str | None = plot.PAGE_TITLE,
    grey: bool = plot.IN_GREY,
    no_marks: bool = plot.NO_MARKS,
    exact: bool = plot.DRAW_EXACT,
    threads: int | None = common.THREADS,
    dask: str | None = run.DASK,
    dry_run: bool = run.DRY_RUN,
    resume: bool = common.RESUME,
    overwrite: bool = common.OVERWRITE,
    quiet: bool = run.QUIET,
) -> None:
    """Compute a piece of a sweep with the same number of points along its axes, and draw it."""
    from sweeps.plotting.page import Page
    from sweeps.plotting.saving import check_picture
    from sweeps.store.paths import check_output, refuse_both

    existing = {"overwrite": overwrite, "resume": resume}
    refuse_both(**existing)
    axes, coordinate, limits = _pieces_and_limits(pieces, coordinate)
    inches = common.inches("--width", width)
    page = Page(ylim=limits, yunit="", width=inches, title=title, grey=grey, marks=not no_marks)
    with common.opened_in_si(file, verify=False) as sweep:  # refuses a configuration
        _refuse_replaced(overrides, axes)
        whole = run.config_in(sweep, file, overrides)
        _check_picture(sweep, whole, page, coordinate, exact)
        outside = list(_outside(sweep, axes))
        if whole.start == sweep.config.start:
            start = whole.start.model_copy(update=_state_before(sweep, axes))
            whole = whole.model_copy(update={"start": start})
    config = zoomed(whole, axes)
    named = file.with_name(_named_after(file, axes, overrides))
    path = output or (named if whole.output == file else whole.output)
    figure = path.with_suffix(".png")
    check_output(path, **existing)
    check_picture(figure)
    for line in outside * (not quiet):
        common.say(line, error=True)
    with run.client_of(dask, threads) as client:
        if dry_run:
            common.say(run.planned_text(config, path, threads, client, resume))
            return
        run.run_and_report(config, path, quiet, threads=threads, client=client, **existing)
    with raised_at_once(), common.opened_in_si(path, verify=False) as sweep:
        options: dict[str, Any] = {"coordinate": coordinate, "exact": {} if exact else None}
        plot.draw_picture(sweep, figure, None, {}, page, quiet=quiet, **options)


def _pieces_and_limits(
    texts: Sequence[str], coordinate: str | None
) -> tuple[dict[str, Limits], str | None, Limits | None]:
    """Read the pieces of axes; return also the coordinate that is drawn, and its limits if any."""
    from sweeps.opened.coordinates import ORDINATES

    limits = dict(map(_piece, texts))
    axes = {name: piece for name, piece in limits.items() if name not in ORDINATES}
    names = [name for name in limits if name in ORDINATES]
    if len(names) > 1 or not axes or len(limits) < len(texts):
        raise Refused(
            f"{' '.join(texts)} is not allowed; expected: each name once, at least one swept "
            f"axis, and at most one of {', '.join(ORDINATES)}"
        )
    if not names:
        return axes, coordinate, None
    if coordinate not in (None, *names):
        raise Refused(f"--coordinate {coordinate} and limits of {names[0]} exclude each other")
    return axes, names[0], limits[names[0]]


def _check_picture(
    sweep: OpenedSweep, whole: SweepConfig, page: Page, coordinate: str | None, exact: bool
) -> None:
    """Refuse what the picture of the piece, a part of `whole` with these axes, cannot have."""
    from sweeps.bifurcation.exact_branches import lines_of
    from sweeps.opened.coordinates import ORDINATES
    from sweeps.plotting.api import KINDS, check_options, default_kind
    from sweeps.plotting.canvas import Picture
    from sweeps.plotting.contents import refuse_without_branches, select_line, with_coordinate

    if coordinate not in ORDINATES:
        with_coordinate(sweep, coordinate)
    options = {"coordinate": coordinate, "exact": exact or None}
    chosen: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    kind = default_kind(sweep, **chosen)
    check_options(kind, chosen, Path("piece.png"))
    if not page.marks and "axes" not in KINDS[kind].options:
        raise Refused(f"--no-marks is not allowed for {kind}; expected: a diagram or a map")
    if exact:
        axes = sweep.map_axes((), None) if kind == "map" else [select_line(sweep)[1]]
        for axis in axes:
            lines_of(sweep, axis)
        refuse_without_branches(coordinate or "poincare_x")
    if page.title:
        Picture(page).add_title(page.title)
    variable = None if coordinate is None else ORDINATES[coordinate]
    if variable and variable.dimension == "impact" and not whole.record.impacts:
        raise Refused(f"the piece has no {coordinate} to draw: record.impacts is 0")
    if variable and variable.diagnostic not in (None, *whole.record.diagnostics):
        problem = f"{variable.diagnostic} is no diagnostic of it"
        raise Refused(f"the piece has no {coordinate} to draw: {problem}")


def _outside(sweep: OpenedSweep, pieces: Mapping[str, Limits]) -> Iterator[str]:
    """Say which pieces go beyond the values of the sweep."""
    for name, piece in pieces.items():
        low, high = piece
        if name in sweep.axes:
            limits = float(sweep[name].min()), float(sweep[name].max())
            if low < limits[0] or high > limits[1]:
                part, whole = (" .. ".join(map(fewest_digits, each)) for each in (piece, limits))
                yield f"{name} = {part} goes beyond the sweep, which has {whole}"


def _refuse_replaced(overrides: Sequence[str], axes: Iterable[str]) -> None:
    """Refuse overrides of what the piece chooses."""
    replaced = {f"{name}.{end}" for name in axes for end in ("start", "stop")}
    for text in overrides:
        key = text.partition("=")[0].strip()
        if key.partition(".")[2] in replaced:
            raise Refused(f"--set {text} is not allowed; the piece chooses {key}")


def _state_before(sweep: OpenedSweep, pieces: Mapping[str, Limits]) -> dict[str, float]:
    """Return the state before a piece of the only axis, followed one way; empty if none fits."""
    if len(pieces) != 1 or len(sweep.spec.directions) != 1 or sweep.axes != tuple(pieces):
        return {}
    ((axis, (low, high)),) = pieces.items()
    goes_up, values = sweep.spec.directions == ("up",), sweep[axis].values.tolist()
    before = [value for value in values if (value <= low if goes_up else value >= high)]
    if not before:
        return {}
    index = {axis: values.index(max(before) if goes_up else min(before)), "section": -1}
    x, v = (float(sweep[name][index]) for name in ("poincare_x", "poincare_v"))
    stop = sweep.nomenclature.name("clearance")
    least = low if axis == stop else sweep[stop].item()  # a start must not be beyond the stop
    return {"x0": min(x, least), "v0": v, "phase": sweep.spec.phase} if isfinite(x) else {}


def zoomed(config: SweepConfig, pieces: Mapping[str, Limits]) -> SweepConfig:
    """Return the same sweep over pieces (low, high) of its axes, with as many points along each.

    A range keeps its linear or logarithmic spacing; a list becomes a linear range. The number of
    steps per period is raised if exact impacts need more steps beyond the ends of the sweep. Raises
    Refused if an axis is not swept, and ConfigError if the sweep is not valid over a piece.
    """
    from sweeps.config.loading import load_config
    from sweeps.yaml_text import yaml_mapping

    if config.points is not None:
        raise Refused("the rows of a table have no axis to zoom into")
    data = yaml_mapping(config.to_yaml(), "the configuration")
    nomenclature = config.nomenclature
    axes = {nomenclature.name(key): values for key, values in config.sweep.grid.axes.items()}
    for name, (low, high) in pieces.items():
        if name not in axes:
            raise Refused(
                f"{name} is not a swept axis{suggestion(near_misses(name, axes))}; "
                f"expected: {' or '.join(axes) or 'none, since this is a single point'}"
            )
        group = data[nomenclature.group if name in data[nomenclature.group] else "start"]
        spacing = group[name]["spacing"] if isinstance(group[name], dict) else "linear"
        group[name] = {"start": low, "stop": high, "num": len(axes[name]), "spacing": spacing}
    if config.method.impact == "exact":  # find the number of steps that the piece needs
        enough = load_config({**data, "method": {**data["method"], "steps_per_period": None}})
        steps = max(each.sweep.spec.steps_per_period for each in (config, enough))
        data["method"]["steps_per_period"] = steps
    return load_config(data)


def _piece(text: str) -> tuple[str, Limits]:
    """Read a name with its limits."""
    name, _, limits = text.partition("=")
    piece = common.interval(limits)
    if not name.strip() or piece is None:
        raise Refused(refusal(text, f"NAME={common.LIMITS}, as omega=2.71:2.76"))
    return name.strip(), piece


def _named_after(file: Path, axes: dict[str, Limits], overrides: Sequence[str]) -> str:
    """Name a file after its pieces and overrides, in place of those that its name already has."""
    from sweeps.config.sweep import dotted_keys

    stem, chosen = file.stem, {}
    others = "|".join([*map(re.escape, dotted_keys(3)), rf"\w+-{_NUMBER}-{_NUMBER}"])
    for name in axes:
        stem = re.sub(rf"-{name}-{_NUMBER}-{_NUMBER}(?=-|$)", "", stem)
    words = [
        f"{name}-{fewest_digits(low)}-{fewest_digits(high)}" for name, (low, high) in axes.items()
    ]
    for text in overrides:
        key, _, value = text.partition("=")
        stem = re.sub(rf"-{re.escape(key.strip())}-.+?(?=-(?:{others})(?:-|$)|$)", "", stem)
        chosen[key.strip()] = value.strip()
    words += [f"{key}-{value}" for key, value in chosen.items()]
    return common.name_after(stem, words, ".h5")

"""The list of bifurcations as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.opened.opened_sweep import START_AXES, OpenedSweep
from sweeps.store import DIRECTION
from sweeps.text import command, fewest_digits, shown_count, shown_range, table
from vibroimpact.points.regimes import Label

if TYPE_CHECKING:
    import pandas as pd

#: Most bifurcations that are listed one by one, and most of those without an exact value.
_MOST_ROWS, _MOST_INEXACT = 40, 12
#: Explanations of the kinds that are not standard terms.
_MEANINGS = {
    "basin": "the motion of one side is stable on the other, too, but the start reaches another",
    "crisis": "the chaos ends as it touches the unstable orbit at its border",
    "unknown": "the motions could not be followed to where one of them ends",
}


def bifurcation_report(sweep: OpenedSweep, file: Path, found: pd.DataFrame) -> str:
    """Write the bifurcations of a sweep that `find_bifurcations` found in a file."""
    axis = found.attrs["axis"]
    if found.empty:
        parts = [f"the class of the motion does not change along {axis}"]
    elif _is_summary(found):
        name, value = found.columns[0], _label(found.iat[0, 0])
        parts = [f"{_summary(found)}; one by one: --at {name}={value}, or --csv FILE"]
        parts += ["\n".join(_meanings(found))]
    else:
        parts = _one_by_one(found)
    notes = [_following(sweep, found), _narrowing(file, found), _unclassified(sweep, found)]
    parts += ["\n".join(filter(None, notes)), found.attrs["branches"]]
    return "\n\n".join(filter(None, parts))


def _one_by_one(found: pd.DataFrame) -> list[str]:
    """Return the tables of bifurcations, those with an exact value first, and notes on them."""
    inexact = found["value"].isna() & (found["kind"] != "crisis")
    listed, others = found[~inexact], found[inexact]
    parts, narrow = [], 0
    if len(listed) > _MOST_ROWS:
        narrow = int(listed["narrow"].sum())
        listed = listed[~listed["narrow"]]
    if len(others) <= _MOST_INEXACT:
        listed = found.loc[[*listed.index, *others.index]]
    if len(listed):
        head = [*found.attrs["heads"], "kind", "orbit", "classes", "between", ""]
        parts.append(table([head, *(_row(found, item) for item in listed.to_dict("records"))]))
    if narrow:
        parts.append(f"{narrow} more on branches that are stable over less than 1 % of the axis")
    if len(others) > _MOST_INEXACT:
        parts.append(f"{len(others)} changes without an exact value\n{_summary(others)}")
    return [*parts, "\n".join([*_cascades(found), *_meanings(found)])]


def _unclassified(sweep: OpenedSweep, found: pd.DataFrame) -> str:
    """Write how many points have no known class, so that the list says nothing about them."""
    if not found.attrs["unclassified"]:
        return ""
    number = shown_count(found.attrs["unclassified"], "point")
    text = f"unknown or without a result: {number}"
    return text if "lyapunov" in sweep else f"{text}; Lyapunov exponents tell which are chaotic"


def _following(sweep: OpenedSweep, found: pd.DataFrame) -> str:
    """Write the key that keeps a motion from changing to another attractor, where one does so."""
    axis = found.attrs["axis"]
    several_starts = {*START_AXES} & {axis, *found.attrs["others"]}
    if several_starts or sweep.spec.followed is not None or "basin" not in {*found["kind"]}:
        return ""
    return (
        "each point starts alone, and another attractor takes over at a change of kind basin; to "
        f"stay on one motion: follow: {{axis: {axis}, direction: up}}, or down"
    )


def _narrowing(file: Path, found: pd.DataFrame) -> str:
    """Write the command that narrows the first change listed without an exact value, if any."""
    inexact = found[found["value"].isna()]
    if inexact.empty or _is_summary(found):
        return ""
    low, high = (fewest_digits(float(inexact[name].iat[0])) for name in ("low", "high"))
    which = f"the {'' if len(inexact) == 1 else 'first '}change without an exact value"
    piece = f"{found.attrs['axis']}={low}:{high}"
    return f"to narrow {which}: {command('zoom', file, piece)}"


def _meanings(found: pd.DataFrame) -> list[str]:
    kinds = set(found["kind"])
    return [f"{kind}: {text}" for kind, text in _MEANINGS.items() if kind in kinds]


def _is_summary(found: pd.DataFrame) -> bool:
    """Whether there are several lines with too many bifurcations to list them one by one."""
    return len(found) > _MOST_ROWS and bool(set(found.attrs["others"]) - {DIRECTION})


def _row(found: pd.DataFrame, item: Mapping[str, Any]) -> list[str]:
    between = item["between"]
    unknown = f"{shown_count(between, 'point')} unknown" if between else ""
    return [
        *(_label(item[name]) for name in found.attrs["others"]),
        "" if np.isnan(item["value"]) else f"{item['value']:.12g}",
        item["kind"],
        item["orbit"],
        _pair(item),
        f"{item['low']:.12g} .. {item['high']:.12g}",
        f"{item['criticality']} {unknown}".strip(),
    ]


def _pair(item: Mapping[str, Any]) -> str:
    """Write the classes in the order of the axis; the arrow points where the line was followed.

    At a subcritical flip it leads away from the stable orbit, from which the motion jumps.
    """
    before, after = str(item["before"]), str(item["after"])
    back = item["down"]
    if item["criticality"] == "subcritical" and item["orbit"] in (before, after):
        back = item["orbit"] == after
    return f"{before} {'<-' if back else '->'} {after}"


def _label(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _summary(found: pd.DataFrame) -> str:
    """Write a row for each kind and pair of classes, the most frequent first."""
    others = found.attrs["others"]
    pairs = [_pair(item) for item in found.to_dict("records")]
    groups = list(found.assign(pair=pairs).groupby(["kind", "pair"], sort=False))
    rows = [
        [
            *group,
            f"{len(items):,}",
            shown_range([*items["low"], *items["high"]]),
            *(shown_range(items[name]) for name in others),
        ]
        for group, items in sorted(groups, key=lambda one: -len(one[1]))
    ]
    *heads, of_axis = found.attrs["heads"]
    lines = [table([["kind", "classes", "times", of_axis, *heads], *rows[:_MOST_ROWS]])]
    if len(rows) > _MOST_ROWS:
        lines.append(f"and {shown_count(len(rows) - _MOST_ROWS, 'rarer pair')} of classes")
    if others:
        lines.append(f"{shown_count(len(found), 'change')} along {found.attrs['axis']}")
    return "\n".join(lines)


def _cascades(found: pd.DataFrame) -> Iterator[str]:
    """Yield a line for each cascade of flips: their values and the ratios of their distances."""
    others = found.attrs["others"]
    for at, line in found.groupby(others, sort=False) if others else [((), found)]:
        changes = zip(line["place"], line["before"], line["after"], strict=True)
        for run in cascades(list(changes)):
            flips = ", ".join(f"{value:.9g}" for value in run)
            ratios = ", ".join(f"{a / b:.4g}" for a, b in pairwise(np.diff(run)))
            where = [f"{name} = {_label(value)}" for name, value in zip(others, at, strict=True)]
            text = f"cascade: {found.attrs['axis']} = {flips}; ratios of the distances {ratios}"
            yield ", ".join([*where, text])


def cascades(changes: Sequence[tuple[float, Label, Label]]) -> Iterator[list[float]]:
    """Yield the values of at least three flips in a row, each of the orbit of the previous flip.

    `changes` are values of the axis, in its order, with the classes before and after.
    """
    for step in (1, -1):
        run, reached = list[float](), None
        for value, *classes in changes[::step]:
            parent, doubled = classes[::step]
            if not parent.doubles_to(doubled):
                continue
            if parent != reached:
                yield from [run] * (len(run) >= 3)
                run = []
            run, reached = [*run, value], doubled
        yield from [run] * (len(run) >= 3)

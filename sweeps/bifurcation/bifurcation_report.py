"""The list of bifurcations as text: points without a class, ratios of a cascade, hints."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.opened.opened_sweep import START_AXES, OpenedSweep
from sweeps.store.variables import DIRECTION
from sweeps.text import command, fewest_digits, shown_count, shown_range, table
from vibroimpact.points.regimes import RESTING, Label, chaos_hint

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


def bifurcation_report(sweep: OpenedSweep, file: Path, changes: pd.DataFrame) -> str:
    """Write the bifurcations of a sweep that `find_bifurcations` found in a file."""
    axis = changes.attrs["axis"]
    if changes.empty:
        texts = [f"the class of the motion does not change along {axis}"]
    elif _is_summary(changes):
        name, value = changes.columns[0], _label(changes.iat[0, 0])
        texts = [f"{_summary(changes)}; one by one: --at {name}={value}, or --csv FILE"]
        texts += ["\n".join(_meanings(changes))]
    else:
        texts = _one_by_one(changes)
    notes = [_following(sweep, changes), _narrowing(file, changes), _unclassified(sweep, changes)]
    texts += ["\n".join(filter(None, notes)), changes.attrs["branches"]]
    return "\n\n".join(filter(None, texts))


def _one_by_one(changes: pd.DataFrame) -> list[str]:
    """Return the table of bifurcations in their order, a summary of what it lacks, and notes."""
    inexact = changes["value"].isna() & (changes["kind"] != "crisis")
    listed, others = changes[~inexact], changes[inexact]
    texts, narrow = [], 0
    if len(listed) > _MOST_ROWS:
        narrow = int(listed["narrow"].sum())
        listed = listed[~listed["narrow"]]
    if len(others) <= _MOST_INEXACT:
        listed = changes.loc[listed.index.union(others.index)]
    if len(listed):
        head = [*changes.attrs["heads"], "kind", "orbit", "classes", "between", ""]
        texts.append(table([head, *(_row(changes, item) for item in listed.to_dict("records"))]))
    if narrow:
        texts.append(f"{narrow} more on branches that are stable over less than 1 % of the axis")
    if len(others) > _MOST_INEXACT:
        texts.append(f"{len(others)} changes without an exact value\n{_summary(others)}")
    return [*texts, "\n".join([*_cascades(changes), *_meanings(changes)])]


def _unclassified(sweep: OpenedSweep, changes: pd.DataFrame) -> str:
    """Write how many points have no known class, so that the list says nothing about them."""
    if not changes.attrs["unclassified"]:
        return ""
    number = shown_count(changes.attrs["unclassified"], "point")
    return f"unknown or without a result: {number}{chaos_hint(sweep, sweep.spec.periods)}"


def _following(sweep: OpenedSweep, changes: pd.DataFrame) -> str:
    """Write the key that keeps a motion from changing to another attractor, where one does so."""
    axis = changes.attrs["axis"]
    several_starts = {*START_AXES} & {axis, *changes.attrs["others"]}
    if several_starts or sweep.spec.followed is not None or "basin" not in {*changes["kind"]}:
        return ""
    return (
        "each point starts alone, and another attractor takes over at a change of kind basin; to "
        f"stay on one motion: follow: {{axis: {axis}, direction: up}}, or down"
    )


def _narrowing(file: Path, changes: pd.DataFrame) -> str:
    """Write the command that narrows the first change listed without an exact value, if any."""
    inexact = changes[changes["value"].isna()]
    if inexact.empty or _is_summary(changes):
        return ""
    low, high = (fewest_digits(float(inexact[name].iat[0])) for name in ("low", "high"))
    which = f"the {'' if len(inexact) == 1 else 'first '}change without an exact value"
    piece = f"{changes.attrs['axis']}={low}:{high}"
    return f"to narrow {which}: {command('zoom', file, piece)}"


def _meanings(changes: pd.DataFrame) -> list[str]:
    return [f"{kind}: {text}" for kind, text in _MEANINGS.items() if kind in {*changes["kind"]}]


def _is_summary(changes: pd.DataFrame) -> bool:
    """Whether there are several lines with too many bifurcations to list them one by one."""
    return len(changes) > _MOST_ROWS and bool(set(changes.attrs["others"]) - {DIRECTION})


def _row(changes: pd.DataFrame, item: Mapping[str, Any]) -> list[str]:
    between = item["between"]
    unknown = f"{shown_count(between, 'point')} unknown" if between else ""
    return [
        *(_label(item[name]) for name in changes.attrs["others"]),
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


def _summary(changes: pd.DataFrame) -> str:
    """Write a row for each kind and pair of classes, rests without periods, most frequent first."""
    others = changes.attrs["others"]
    records = changes.to_dict("records")
    pairs = [re.sub(rf"{RESTING},.*? periods?", RESTING, _pair(item)) for item in records]
    groups = list(changes.assign(pair=pairs).groupby(["kind", "pair"], sort=False))
    rows = [
        [
            *group,
            f"{len(items):,}",
            shown_range([*items["low"], *items["high"]]),
            *(shown_range(items[name]) for name in others),
        ]
        for group, items in sorted(groups, key=lambda one: -len(one[1]))
    ]
    *heads, of_axis = changes.attrs["heads"]
    lines = [table([["kind", "classes", "times", of_axis, *heads], *rows[:_MOST_ROWS]])]
    if len(rows) > _MOST_ROWS:
        lines.append(f"and {shown_count(len(rows) - _MOST_ROWS, 'rarer pair')} of classes")
    if others:
        lines.append(f"{shown_count(len(changes), 'change')} along {changes.attrs['axis']}")
    return "\n".join(lines)


def _cascades(changes: pd.DataFrame) -> Iterator[str]:
    """Yield a line for each cascade of flips: their values and the ratios of their distances."""
    others = changes.attrs["others"]
    for at, line in changes.groupby(others, sort=False) if others else [((), changes)]:
        classes = zip(line["place"], line["before"], line["after"], strict=True)
        for run in cascades(list(classes)):
            flips = ", ".join(f"{value:.9g}" for value in run)
            ratios = ", ".join(f"{a / b:.4g}" for a, b in pairwise(np.diff(run)))
            where = [f"{name} = {_label(value)}" for name, value in zip(others, at, strict=True)]
            text = f"cascade: {changes.attrs['axis']} = {flips}; ratios of the distances {ratios}"
            yield ", ".join([*where, text])


def cascades(changes: Sequence[tuple[float, Label, Label]]) -> Iterator[list[float]]:
    """Yield the values of at least three flips in a row, each of the orbit of the previous flip.

    `changes` are values of the axis, in its order, with the classes before and after.
    """
    for step in (1, -1):
        run, child = list[float](), None
        for value, *classes in changes[::step]:
            parent, doubled = classes[::step]
            if not parent.doubles_to(doubled):
                continue
            if parent != child:
                yield from [run] * (len(run) >= 3)
                run = []
            run, child = [*run, value], doubled
        yield from [run] * (len(run) >= 3)

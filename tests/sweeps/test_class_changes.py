"""Changes of the class of the motion: their kinds and cascades."""

import numpy as np
import pytest

from sweeps.analysis.class_changes import Change, Label, cascades, changes
from sweeps.analysis.motion import Motion

ONE, TWO, FOUR, EIGHT = (Label(Motion.PERIODIC, m, m) for m in (1, 2, 4, 8))
REST, CHAOS = Label(Motion.REST), Label(Motion.CHAOTIC)


def test_points_of_no_known_class_are_passed_over():
    given = [ONE, None, None, ONE, None, TWO, CHAOS]
    assert list(changes(np.arange(7.0), given)) == [
        Change(3.0, 5.0, ONE, TWO, between=1),
        Change(5.0, 6.0, TWO, CHAOS),
    ]


@pytest.mark.parametrize(
    ("before", "after", "kind"),
    [
        (ONE, TWO, "flip"),
        (FOUR, TWO, "flip"),
        (Label(Motion.PERIODIC, 2, 3), Label(Motion.PERIODIC, 2, 4), "unknown"),
        (ONE, FOUR, "unknown"),
        (Label(Motion.PERIODIC, 2, 3), Label(Motion.PERIODIC, 4, 7), "unknown"),
        (ONE, REST, "rest"),
        (CHAOS, REST, "rest"),
        (CHAOS, TWO, "chaos"),
        (Label(Motion.REST, 2, 2), Label(Motion.REST, 2, 1), "unknown"),
        (Label(Motion.REST, 1, 1), Label(Motion.REST, 2, 2), "unknown"),
        (Label(Motion.REST, 1, 1), ONE, "rest"),
    ],
)
def test_kinds_of_change(before, after, kind):
    assert Change(0.0, 1.0, before, after).kind == kind


def test_cascades_run_both_ways_and_break_where_a_flip_is_missing():
    up = [Change(k, k, a, b) for k, (a, b) in enumerate([(ONE, TWO), (TWO, FOUR), (FOUR, EIGHT)])]
    down = [Change(k, k, b, a) for k, (a, b) in enumerate([(FOUR, EIGHT), (TWO, FOUR), (ONE, TWO)])]
    assert list(cascades(up)) == [up]
    assert list(cascades(down)) == [down[::-1]]
    assert list(cascades([*up, Change(5, 6, EIGHT, CHAOS), *down])) == [up, down[::-1]]
    assert list(cascades([up[0], up[2]])) == []

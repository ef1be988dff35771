"""What recorded motions are: kinds, classes m/q and where they change, attractors and their tables.

It reads opened sweeps; how they were computed and how they are drawn is not known here.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.analysis.class_changes import Change as Change
    from sweeps.analysis.class_changes import Label as Label
    from sweeps.analysis.class_changes import changes as changes
    from sweeps.analysis.class_changes import labels as labels
    from sweeps.analysis.distinct_attractors import attractors as attractors
    from sweeps.analysis.motion import Motion as Motion
    from sweeps.analysis.motion import classify as classify
    from sweeps.analysis.table import rows as rows

_HOME = {
    "Change": "class_changes",
    "Label": "class_changes",
    "Motion": "motion",
    "attractors": "distinct_attractors",
    "changes": "class_changes",
    "classify": "motion",
    "labels": "class_changes",
    "rows": "table",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that a command loads only what it needs."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)

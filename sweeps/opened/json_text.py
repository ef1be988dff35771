"""Results as JSON, for other programs: null where there is no value."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def json_text(value: object) -> str:
    """Write mappings, lists, texts and numbers as strict JSON, with all digits.

    NaN, which is no value, becomes null, and an infinite number the text "inf" or "-inf". All other
    characters than printable ASCII are escaped: no terminal and no encoding changes the text.
    """
    text = json.dumps(_in_json(value), indent=2, allow_nan=False)
    return text.replace("\x7f", "\\u007f")


def _in_json(value: Any) -> Any:
    """Convert a value to the types of JSON."""
    if isinstance(value, Mapping):
        return {str(name): _in_json(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _in_json(value.tolist())
    if isinstance(value, list | tuple):
        return [_in_json(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, bool | int | float | str | None) else str(value)

"""Colours are told apart with normal colour vision, deuteranopia and protanopia.

Dichromacy is simulated by the matrices of Machado, Oliveira and Fernandes (2009) at full severity.
"""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from sweeps.plotting import style

with np.printoptions():  # the import changes how numbers are printed, for all tests after it
    import colour


def named_colours():
    """Return every colour of the palette by the first name that it has there."""
    names = {}
    for name, value in vars(style).items():
        if not name.isupper() or name in ("STYLE", "LEAST_SHARE"):
            continue
        entries = value.items() if isinstance(value, dict) else [("", value)]
        for key, entry in entries:
            values = entry if isinstance(entry, tuple) else (entry,)
            for text in values:
                if text.startswith("#"):
                    names.setdefault(text, f"{name} {getattr(key, 'name', key)}")
    return names


@pytest.mark.parametrize("deficiency", ["None", "Deuteranomaly", "Protanomaly"])
def test_every_pair_of_colours_is_told_apart(deficiency):
    names = named_colours()
    assert len(names) >= 15
    matrix = np.eye(3)
    if deficiency != "None":
        matrix = colour.matrix_cvd_Machado2009(deficiency, 1.0)
    linear = colour.models.eotf_sRGB(np.array([to_rgb(text) for text in names]))
    seen = np.clip(linear @ matrix.T, 0.0, 1.0)
    space = colour.RGB_COLOURSPACES["sRGB"]
    lab = colour.XYZ_to_Lab(seen @ space.matrix_RGB_to_XYZ.T, space.whitepoint)
    alike = {
        (one, other): round(float(difference), 1)
        for (one, i), (other, j) in combinations(zip(names.values(), lab, strict=True), 2)
        if (difference := colour.delta_E(i, j, method="CIE 2000")) < 10.0
    }
    assert not alike

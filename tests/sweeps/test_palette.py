"""Colours can be distinguished with normal vision, deuteranopia and protanopia.

Dichromacy is simulated by the matrices of Machado, Oliveira and Fernandes (2009,
doi 10.1109/TVCG.2009.113) at full severity; colour differences are distances in CIE L*a*b* (1976).
"""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from sweeps.plotting import style

VISIONS = {
    "normal": np.eye(3),
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}
#: Of IEC 61966-2-1, whose white is that of D65.
SRGB_TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)


def seen(colours, vision):
    """Return the L*a*b* coordinates of sRGB colours as seen with a colour vision."""
    rgb = np.array([to_rgb(colour) for colour in colours])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = np.clip(linear @ np.transpose(vision), 0.0, 1.0) @ SRGB_TO_XYZ.T / SRGB_TO_XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz * (29 / 6) ** 2 / 3 + 4 / 29).T
    return np.stack([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])], axis=1)


def named_colours():
    """Return every colour of the palette by its first name."""
    names = {}
    for name, value in vars(style).items():
        if not name.isupper() or name in ("STYLE", "LEAST_SHARE", "_NAMED"):
            continue
        entries = value.items() if isinstance(value, dict) else [("", value)]
        for key, entry in entries:
            values = entry if isinstance(entry, tuple) else (entry,)
            for text in values:
                if text.startswith("#"):
                    names.setdefault(text, f"{name} {getattr(key, 'name', key)}")
    return names


def test_the_simulation_keeps_white_and_knows_red():
    for vision in VISIONS.values():
        np.testing.assert_allclose(seen(["white"], vision), [[100.0, 0.0, 0.0]], atol=0.05)
    red = seen(["red"], VISIONS["normal"])  # as tables of colours give it
    np.testing.assert_allclose(red, [[53.24, 80.09, 67.20]], atol=0.05)


@pytest.mark.parametrize("vision", VISIONS)
def test_every_pair_of_colours_is_told_apart(vision):
    names = named_colours()
    assert len(names) >= 15
    lab = seen(names, VISIONS[vision])
    alike = {
        (one, other): round(float(difference), 1)
        for (one, i), (other, j) in combinations(zip(names.values(), lab, strict=True), 2)
        if (difference := np.linalg.norm(i - j)) < 10.0
    }
    assert not alike


def test_a_class_keeps_its_colour_whatever_is_beside_it():
    alone = {pair: style.class_colours([pair])[pair] for pair in [(1, 1), (2, 2), (3, 3), (2, 1)]}
    crowd = style.class_colours([(1, 1), (2, 1), (2, 2), (3, 3), (4, 4), (5, 7)])
    assert {pair: crowd[pair] for pair in alone} == alone
    assert len(set(crowd.values())) == 6

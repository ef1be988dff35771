"""Colours can be distinguished with normal vision, deuteranopia and protanopia.

Dichromacy is simulated by the matrices of Machado, Oliveira and Fernandes (2009,
doi 10.1109/TVCG.2009.113) at full severity; colour differences are CIEDE2000, as written down by
Sharma, Wu and Dalal (2005, doi 10.1002/col.20070).
"""

from itertools import combinations, pairwise

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


def difference(first, second):
    """Return the CIEDE2000 difference of L*a*b* colours, shape (..., 3)."""
    pair = np.moveaxis(np.array([first, second], float), -1, 1)
    (L, a, b), (L2, a2, b2) = pair
    chroma = 0.5 * (np.hypot(a, b) + np.hypot(a2, b2))
    stretch = 1.5 - 0.5 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    C, C2 = np.hypot(stretch * a, b), np.hypot(stretch * a2, b2)
    h, h2 = np.arctan2(b, stretch * a), np.arctan2(b2, stretch * a2)
    turn = (h2 - h + np.pi) % (2.0 * np.pi) - np.pi
    mean_L, mean_C = 0.5 * (L + L2), 0.5 * (C + C2)
    mean_h = np.where(C * C2 > 0.0, h + 0.5 * turn, h + h2)
    T = 1.0 - 0.17 * np.cos(mean_h - np.pi / 6.0) + 0.24 * np.cos(2.0 * mean_h)
    T += 0.32 * np.cos(3.0 * mean_h + np.pi / 30.0) - 0.2 * np.cos(4.0 * mean_h - 0.35 * np.pi)
    far = np.degrees(mean_h) % 360.0
    rotation = np.sin(np.pi / 3.0 * np.exp(-(((far - 275.0) / 25.0) ** 2)))
    rotation *= -2.0 * np.sqrt(mean_C**7 / (mean_C**7 + 25.0**7))
    light = (L2 - L) / (1.0 + 0.015 * (mean_L - 50) ** 2 / np.sqrt(20.0 + (mean_L - 50) ** 2))
    colour = (C2 - C) / (1.0 + 0.045 * mean_C)
    hue = 2.0 * np.sqrt(C * C2) * np.sin(0.5 * turn) / (1.0 + 0.015 * mean_C * T)
    return np.sqrt(light**2 + colour**2 + hue**2 + rotation * colour * hue)


#: Colours that one picture may show beside each other.
IN_A_MAP = {
    **{f"{m}/{q}": colour for (m, q), colour in style.CLASSES.items()},
    **{regime.word: colour for regime, colour in style.REGIMES.items()},
    **{outcome.name: colour for outcome, colour in style.STATUS_COLOURS.items()},
    "other": style.LOOKS[None][0].colour,
}
WAYS = [look.colour for look in style.DIRECTION_LOOKS[False]]
PICTURES = {
    "map": IN_A_MAP,
    "status": style.RESULT_COLOURS | style.STATUS_COLOURS,
    "evidence": style.EVIDENCE | style.STATUS_COLOURS,
    "attractors": dict(enumerate(style.FURTHER)),
    "dots": {
        name: style.DOT_COLOURS.get(of, of) for name, of in IN_A_MAP.items() if name[0] not in "PUN"
    },
    "directions": dict(enumerate((*WAYS, style.BOTH_COLOUR))),
    "strip": {name: colour for name, (colour, _) in style.MARKS.items()}
    | {outcome.name: style.DOT_COLOURS.get(of, of) for outcome, of in style.STATUS_COLOURS.items()}
    | {"up": WAYS[0], "down": WAYS[1]},
}


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("picture", PICTURES)
def test_every_pair_of_colours_of_a_picture_is_told_apart(picture, vision):
    colours = PICTURES[picture]
    lab = dict(zip(colours, seen(colours.values(), VISIONS[vision]), strict=True))
    assert not {
        (str(one), str(other)): round(float(how), 1)
        for one, other in combinations(colours, 2)
        if (how := difference(lab[one], lab[other])) < 10.0
    }


@pytest.mark.parametrize("vision", VISIONS)
def test_a_further_attractor_has_the_colour_of_no_class(vision):
    further, others = seen(style.FURTHER, VISIONS[vision]), seen(IN_A_MAP.values(), VISIONS[vision])
    assert min(difference(one, other) for one in further for other in others) > 9.0


@pytest.mark.parametrize("vision", VISIONS)
def test_frequent_classes_and_neighbours_in_a_cascade_differ_more(vision):
    frequent = [(1, 0), (1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 3), (4, 4)]
    cascades = [[(1, 1), (2, 2), (4, 4), (8, 8)], [(2, 1), (4, 2)], [(4, 3), (8, 6)]]
    doubled = [pair for cascade in cascades for pair in pairwise(cascade)]
    for pairs, least in ((combinations(frequent, 2), 13.0), (doubled, 17.0)):
        for pair in pairs:
            lab = seen([style.CLASSES[one] for one in pair], VISIONS[vision])
            assert difference(*lab) > least, pair


def test_the_hue_says_m_and_the_darker_the_more_impacts():
    for m in {m for m, _ in style.CLASSES}:
        own = sorted(one for one in style.CLASSES if one[0] == m)
        L, a, b = seen([style.CLASSES[one] for one in own], VISIONS["normal"]).T
        assert (np.diff(L) < -8.0).all()
        hues = np.unwrap(np.arctan2(b, a))
        assert np.ptp(np.degrees(hues)) < 35.0, m

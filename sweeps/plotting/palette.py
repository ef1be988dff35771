"""The colours of all pictures, by what they mean.

Every two of them are told apart with normal colour vision, deuteranopia and protanopia: they differ
by at least 10 in CIEDE2000.
"""

from sweeps.analysis.motion import Motion
from vibroimpact.status import Status

# From Okabe and Ito's palette.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
WHITE = "#FFFFFF"

STATUS_COLOURS = {
    Status.PENDING: "#ACA59E",
    Status.UNRESOLVED: "#666666",
    Status.NON_FINITE: "#333333",
}

#: Of the most frequent period classes in a map: without vermilion and black.
PERIODIC = (BLUE, "#56B4E9", "#009E73", "#F0E442", ORANGE, "#CC79A7")
OTHER_PERIODIC = "#D3E4B4"
REST = VERMILION
#: Of the other kinds of motion: their label and their colour.
MOTIONS = {
    Motion.REST: ("with rest on the stop", REST),
    Motion.CHAOTIC: (r"chaotic, $\lambda_1 > 0$", "#000000"),
    Motion.NEUTRAL: (r"quasi-periodic or unsettled, $\lambda_1 \approx 0$", "#4B0082"),
    Motion.UNBOUNDED: ("unbounded", "#7A4A12"),
    Motion.UNDECIDED: ("undecided", "#CCCCCC"),
}
#: Of points with a result in a map of ``status``.
RESULTS = {
    Status.COMPUTED: PERIODIC[1],
    Status.CERTIFIED: PERIODIC[0],
    Status.SETTLED: PERIODIC[4],
    Status.UNBOUNDED: REST,
}

#: Of the periodic attractors, the most frequent first: neighbours in this order are far apart.
ATTRACTORS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#F0E442")
OTHER_ATTRACTORS = OTHER_PERIODIC

#: Of the directions in which an axis was followed, and of what both directions meet.
DIRECTION_COLOURS = (BLUE, ORANGE)
BOTH_COLOUR = "#333333"

#: Of the share of a column's points in a pixel, from the least to 1. All ramps start well away from
#: white, so that a pixel met once is seen.
DENSITY = ("#A6CBE3", BLUE, "#00263D")
LEAST_SHARE = 1e-3

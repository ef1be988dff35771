"""The colours of all pictures, by what they mean."""

from sweeps.analysis.motion import Motion
from vibroimpact.status import Status

# From Okabe and Ito's palette, whose colours are far apart for every kind of colour vision.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
WHITE = "#FFFFFF"

STATUS_COLOURS = {
    Status.PENDING: "#CCCCCC",
    Status.UNRESOLVED: "#777777",
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
    Motion.NEUTRAL: (r"quasi-periodic or unsettled, $\lambda_1 \approx 0$", "#6A3D9A"),
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
OTHER_ATTRACTORS = "#8C8C8C"

#: Of the directions in which an axis was followed, and of what both directions meet.
DIRECTION_COLOURS = (BLUE, ORANGE)
BOTH_COLOUR = "#222222"

"""A forced oscillator with impacts: exact facts, integrators, impact rules and the sweep kernel."""

from vibroimpact.orbits import OneImpactOrbit, bifurcation, one_impact_orbit, one_impact_orbits
from vibroimpact.oscillator import Oscillator
from vibroimpact.paper import PaperRun, paper_procedure
from vibroimpact.periodic import PeriodicOrbit, periodic_orbit
from vibroimpact.status import Status
from vibroimpact.trajectory import Trajectory, simulate

__all__ = [
    "OneImpactOrbit",
    "Oscillator",
    "PaperRun",
    "PeriodicOrbit",
    "Status",
    "Trajectory",
    "bifurcation",
    "one_impact_orbit",
    "one_impact_orbits",
    "paper_procedure",
    "periodic_orbit",
    "simulate",
]

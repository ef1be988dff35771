"""A forced oscillator with impacts: exact facts, integrators, impact rules and the sweep kernel."""

from vibroimpact.integrate import integrate
from vibroimpact.orbits.branches import Branch, branch
from vibroimpact.orbits.curves import Curve, bifurcation_curve
from vibroimpact.orbits.one_impact import (
    OneImpactOrbit,
    bifurcation,
    one_impact_orbit,
    one_impact_orbits,
)
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.paper import PaperRun, paper_procedure
from vibroimpact.status import Status
from vibroimpact.trajectory import Trajectory, simulate

__all__ = [
    "Branch",
    "Curve",
    "OneImpactOrbit",
    "OrbitError",
    "Oscillator",
    "PaperRun",
    "PeriodicOrbit",
    "Status",
    "Trajectory",
    "bifurcation",
    "bifurcation_curve",
    "branch",
    "integrate",
    "one_impact_orbit",
    "one_impact_orbits",
    "paper_procedure",
    "periodic_orbit",
    "simulate",
]

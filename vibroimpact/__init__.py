"""A forced oscillator with impacts: exact facts, integrators, impact rules and the sweep kernel."""

from vibroimpact.oscillator import Oscillator
from vibroimpact.paper import PaperRun, paper_procedure
from vibroimpact.status import Status
from vibroimpact.trajectory import Trajectory, simulate

__all__ = ["Oscillator", "PaperRun", "Status", "Trajectory", "paper_procedure", "simulate"]

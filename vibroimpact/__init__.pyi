from .kernel.integrate import integrate as integrate
from .orbits.branches import Branch as Branch
from .orbits.branches import branch as branch
from .orbits.curves import bifurcation_curve as bifurcation_curve
from .orbits.one_impact import one_impact_orbit as one_impact_orbit
from .orbits.one_impact import one_impact_orbits as one_impact_orbits
from .orbits.periodic import OrbitError as OrbitError
from .orbits.periodic import PeriodicOrbit as PeriodicOrbit
from .orbits.periodic import periodic_orbit as periodic_orbit
from .oscillator import POINT as POINT
from .oscillator import Oscillator as Oscillator
from .paper import PaperRun as PaperRun
from .paper import paper_procedure as paper_procedure
from .status import Status as Status
from .step.scheme import IMPACT_RULES as IMPACT_RULES
from .step.scheme import INTEGRATORS as INTEGRATORS
from .trajectory import Trajectory as Trajectory
from .trajectory import simulate as simulate

__version__: str

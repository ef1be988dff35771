"""`Oscillator` of eq. (1), also as a `POINT`: each `Parameter`, its default and valid range.

The system is one mass, one stop and one harmonic force::

    x'' + 2 h x' + p^2 x = -(f + a omega^2) sin(omega t),    x <= clearance    (1)
    when x >= clearance and x' > 0:  x = clearance,  x'+ = -R x'-             (2)-(5)

``PARAMETERS`` is the only place that names, describes and bounds the parameters; configuration,
files and axis labels all use it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any, Self

import numpy as np

from vibroimpact.inputs import PHASE, input_text, real, refusal


@dataclass(frozen=True)
class Parameter:
    """One parameter of eq. (1) or of its start."""

    symbol: str  #: As printed in a formula (mathtext, without the dollar signs).
    meaning: str
    unit: str  #: In terms of ``time`` and ``length``.
    low: float = -math.inf  #: The valid interval, closed at both ends unless `low_open`.
    high: float = math.inf
    low_open: bool = False
    default: float | None = None  #: None if the parameter must be given.
    turns: bool = False  #: Whether it is an angle, below one turn.

    @property
    def allowed(self) -> str:
        """The valid values, in words."""
        if self.turns:
            return PHASE.expected
        if self.high < math.inf:
            return f"a number from {self.low:g} to {self.high:g}"
        if self.low > -math.inf:
            return f"a finite number {'>' if self.low_open else '>='} {self.low:g}"
        return "a finite number"

    def accepts(self, value: Any) -> Any:
        """Whether `value` is finite and inside the valid interval, elementwise."""
        above = value > self.low if self.low_open else value >= self.low
        return above & (value <= self.high) & (abs(value) < math.inf)


PARAMETERS: Mapping[str, Parameter] = {
    "h": Parameter("h", "viscous damping coefficient", "1/time", low=0.0),
    "R": Parameter("R", "coefficient of restitution", "1", low=0.0, high=1.0),
    "omega": Parameter(r"\omega", "forcing frequency", "rad/time", low=0.0, low_open=True),
    "f": Parameter("f", "forcing amplitude", "length/time^2", low=0.0),
    "p": Parameter("p", "eigenfrequency", "rad/time", low=0.0, low_open=True, default=1.0),
    "clearance": Parameter(r"\sigma", "clearance", "length", default=0.0),
    "a": Parameter("a", "amplitude of the base or unbalance", "length", low=0.0, default=0.0),
    "x0": Parameter("x_0", "initial displacement", "length", default=0.0),
    "v0": Parameter("v_0", "initial velocity", "length/time", default=0.0),
    "phase": Parameter(
        r"\omega t_0", "forcing phase at the start", "rad", 0.0, math.nextafter(math.tau, 0.0),
        default=0.0, turns=True,
    ),
}  # fmt: skip

_FORCE = "the force f + a omega^2"
#: Default of f, which becomes 0.
_NOT_GIVEN: Any = None

#: One parameter point. The kernel sweeps a structured array of this dtype.
POINT = np.dtype([(name, np.float64) for name in PARAMETERS])


def checked(name: str, value: object) -> float:
    """Return `value` as a float; TypeError if it is not a real number, ValueError if not valid."""
    parameter = PARAMETERS[name]
    return _number(f"{name} ({parameter.meaning})", value, parameter)


def _number(title: str, value: object, bounds: Parameter) -> float:
    """Return `value` as a float; messages call it by its `title`."""
    number = real(value)
    if number is not None and bounds.accepts(number):
        return number
    text = f"{title} = {input_text(value)}"
    if number is None:
        hint = ""
        if isinstance(value, (np.ndarray, Sequence)) and not isinstance(value, (str, bytes)):
            hint = (
                "; for many points at once use vibroimpact.integrate, or for a sweep over an axis "
                "sweeps.run_sweep"
            )
        raise TypeError(refusal(text, bounds.allowed) + hint)
    raise ValueError(refusal(text, bounds.allowed))


@dataclass(frozen=True)
class Oscillator:
    """A forced linear oscillator with one rigid stop, eq. (1) with the impact rule (2)-(5).

    Parameters
    ----------
    h : float
        Viscous damping coefficient [1/time], >= 0; eq. (1) carries 2h, so h = p is critical.
    R : float
        Coefficient of restitution, 0 to 1.
    omega : float
        Forcing frequency [rad/time], > 0.
    f : float, optional
        Forcing amplitude [length/time^2], >= 0; 0 if `a` is given, otherwise required.
    p : float, optional
        Eigenfrequency of the undamped system [rad/time], > 0.
    clearance : float, optional
        Distance from the rest position to the stop [length]; negative is a preload.
    a : float, optional
        Amplitude of a base that moves by -a sin(omega t), to which x is then relative, or of an
        unbalance (its share of the mass times its eccentricity) [length], >= 0. It adds the force
        a omega^2 to `f`.

    Raises
    ------
    TypeError, ValueError
        If a parameter is not a number or not in its valid range, or if the force is not finite.

    Examples
    --------
    >>> osc = Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0)
    >>> osc.clearance, round(osc.forcing_period, 6)
    (0.0, 2.73182)
    """

    h: float
    R: float
    omega: float
    f: float = _NOT_GIVEN
    p: float = 1.0
    clearance: float = 0.0
    a: float = 0.0

    def __post_init__(self) -> None:
        if self.f is _NOT_GIVEN:
            if checked("a", self.a) == 0.0:
                raise TypeError("f (forcing amplitude) is missing; expected: f, a > 0, or both")
            object.__setattr__(self, "f", 0.0)
        for field in fields(self):
            object.__setattr__(self, field.name, checked(field.name, getattr(self, field.name)))
        if not math.isfinite(self.force):
            raise ValueError(f"{_FORCE} must be a finite number, not {self.force} at {self}")

    @classmethod
    def from_rig(
        cls,
        *,
        mass: float,
        stiffness: float,
        damping: float,
        frequency: float,
        gap: float,
        R: float,
        force: float | None = None,
        base: float = 0.0,
    ) -> Self:
        """Return the oscillator of a rig in SI units, by dividing the rig's equation by its mass.

        The rig is m x'' + c x' + k x = -F sin(2 pi nu t) with x <= gap. Hence h = c / (2 m),
        p = sqrt(k / m), f = F / m, omega = 2 pi nu and clearance = gap. A base that carries spring,
        damper and stop, and moves by -a sin(2 pi nu t), adds m a omega^2 to F; x is then relative
        to it. The units of the oscillator are m and s.

        Parameters
        ----------
        mass : float
            m [kg], > 0.
        stiffness : float
            k of the spring [N/m], > 0.
        damping : float
            c of the viscous damper [N s/m], >= 0.
        frequency : float
            nu of the force or of the base [Hz], > 0.
        gap : float
            Distance from the rest position to the stop [m]; negative is a preload.
        R : float
            Coefficient of restitution, 0 to 1.
        force : float, optional
            Amplitude F of the force [N], >= 0; 0 if `base` is given, otherwise required.
        base : float, optional
            Amplitude a of the base [m], >= 0. Of a base with a given amplitude of its
            acceleration, the force is the mass times this acceleration.

        Raises
        ------
        TypeError, ValueError
            If a quantity is not a number or not in its valid range.

        See Also
        --------
        to_rig : the way back.

        Examples
        --------
        >>> rig = dict(mass=2.0, stiffness=800.0, damping=1.2, force=10.0, frequency=4.0)
        >>> osc = Oscillator.from_rig(**rig, gap=5e-4, R=0.7)
        >>> osc.h, osc.p, osc.f
        (0.3, 20.0, 5.0)
        """
        base = _number("base [m]", base, PARAMETERS["a"])
        if force is None and base == 0.0:
            raise TypeError("force [N] is missing; expected: force, base > 0, or both")
        # Each quantity has the valid range of the parameter that is computed from it.
        mass = _number("mass [kg]", mass, PARAMETERS["p"])
        return cls(
            h=_number("damping [N s/m]", damping, PARAMETERS["h"]) / (2.0 * mass),
            R=R,
            omega=2.0 * math.pi * _number("frequency [Hz]", frequency, PARAMETERS["omega"]),
            f=_NOT_GIVEN if force is None else _number("force [N]", force, PARAMETERS["f"]) / mass,
            p=math.sqrt(_number("stiffness [N/m]", stiffness, PARAMETERS["p"]) / mass),
            clearance=_number("gap [m]", gap, PARAMETERS["clearance"]),
            a=base,
        )

    def to_rig(self, mass: float) -> dict[str, float]:
        """Return the rig of a given mass that this oscillator describes, in SI units.

        A sweep gives impulse and energy lost per unit of mass; multiply them by `mass`.

        Parameters
        ----------
        mass : float
            [kg], > 0.

        Returns
        -------
        dict of str to float
            The arguments of `from_rig`, which gives this oscillator again, to rounding.

        Raises
        ------
        TypeError, ValueError
            If `mass` is not a number > 0, or if a quantity of the rig overflows or underflows.

        Examples
        --------
        >>> Oscillator(h=0.3, R=0.7, omega=25.0, f=5.0, p=20.0).to_rig(mass=2.0)["stiffness"]
        800.0
        """
        mass = _number("mass [kg]", mass, PARAMETERS["p"])
        rig = {
            "mass": mass,
            "stiffness": mass * (self.p * self.p),
            "damping": 2.0 * mass * self.h,
            "frequency": self.omega / (2.0 * math.pi),
            "gap": self.clearance,
            "R": self.R,
            "force": mass * self.f,
            "base": self.a,
        }
        again = self.from_rig(**rig)  # refuses a quantity that overflows
        if not all(map(math.isclose, astuple(again), astuple(self))):
            allowed = "a mass whose rig does not underflow"
            raise ValueError(refusal(f"mass [kg] = {mass!r}", allowed))
        return rig

    @property
    def force(self) -> float:
        """Amplitude of the whole force, f + a omega^2 [length/time^2]."""
        return self.f + self.a * self.omega * self.omega

    @property
    def forcing_period(self) -> float:
        """2 pi / omega [time]."""
        return 2.0 * math.pi / self.omega

    def at(self, x0: float = 0.0, v0: float = 0.0, phase: float = 0.0) -> np.ndarray:
        """Return this oscillator with a start, as one parameter point of dtype ``POINT``.

        Parameters
        ----------
        x0, v0 : float
            Displacement (<= clearance) [length] and velocity [length/time].
        phase : float
            omega t at the start, in [0, 2 pi) [rad].

        Returns
        -------
        ndarray, shape (1,)

        Raises
        ------
        TypeError, ValueError
            If the start is not a number, not finite, or beyond the stop.

        Examples
        --------
        >>> Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0).at(x0=-0.5)["x0"]
        array([-0.5])
        """
        x0, v0, phase = checked("x0", x0), checked("v0", v0), checked("phase", phase)
        if x0 > self.clearance:
            raise ValueError(
                f"x0 = {x0:g} lies beyond the stop: it must be <= clearance = {self.clearance:g}"
            )
        values = tuple(getattr(self, field.name) for field in fields(self))
        return np.array([(*values, x0, v0, phase)], dtype=POINT)


def point_of(osc: Oscillator) -> np.ndarray:
    """Return an oscillator as an array of one ``POINT``."""
    return osc.at(min(0.0, osc.clearance))


def oscillator_of(point: Mapping[Any, Any] | np.void) -> Oscillator:
    """Return the oscillator with parameters given by name."""
    return Oscillator(**{field.name: float(point[field.name]) for field in fields(Oscillator)})


def refuse_invalid(points: object, beyond_stop: bool) -> None:
    """Raise an error unless `points` are valid parameter points; `beyond_stop` allows such x0.

    TypeError if it is not an array of dtype ``POINT``, ValueError if its shape or a value is not
    valid.
    """
    if not isinstance(points, np.ndarray) or points.dtype != POINT or np.ma.isMA(points):
        raise TypeError(refusal(f"points = {input_text(points)}", "an array of the dtype POINT"))
    if points.ndim != 1:
        raise ValueError(refusal(f"points of the shape {points.shape}", "the shape (n,)"))
    for name, parameter in PARAMETERS.items():
        values = points[name]
        wrong, stop = ~parameter.accepts(values), points["clearance"]
        beyond = name == "x0" and not beyond_stop and not wrong.any()
        wrong = values > stop if beyond else wrong
        if wrong.any():
            row = int(np.argmax(wrong))
            allowed = f"at most the clearance = {stop[row]:g}" if beyond else parameter.allowed
            given = f"points[{row}]: {name} ({parameter.meaning}) = {float(values[row])!r}"
            raise ValueError(refusal(given, allowed))
    if not (finite := np.isfinite(with_one_force(points)["f"])).all():
        row = int(np.argmin(finite))
        raise ValueError(f"points[{row}]: {_FORCE} must be a finite number, not inf")


def with_one_force(points: np.ndarray) -> np.ndarray:
    """Return a copy of points for compiled code, with the whole force as f, and a = 0."""
    points = np.array(points, POINT)  # contiguous and writable, as compiled code needs it
    with np.errstate(over="ignore"):
        points["f"] += points["a"] * points["omega"] * points["omega"]
    points["a"] = 0.0
    return points


def mesh(axes: Mapping[str, np.ndarray], fixed: Mapping[str, float]) -> np.ndarray:
    """Return the parameter points of a grid, shape (n,): the product of its axes in C order.

    `axes` maps each axis, slowest first, to the values of its parameter. An axis along which
    several parameters vary has a structured array with a field for each; other fields are ignored.
    `fixed` holds the values of all other parameters.
    """
    rows = np.meshgrid(*(np.arange(len(values)) for values in axes.values()), indexing="ij")
    points = np.empty(math.prod(map(len, axes.values())), dtype=POINT)
    for name, value in fixed.items():
        points[name] = value
    for (axis, values), row in zip(axes.items(), rows, strict=True):
        for name, column in parameters_of(axis, values).items():
            points[name] = column[row.ravel()]
    return points


def parameters_of(axis: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return the parameters that vary along an axis of `mesh`, by name, shape (n,) each."""
    if values.dtype.names is None:
        return {axis: values}
    return {name: values[name] for name in values.dtype.names if name in PARAMETERS}

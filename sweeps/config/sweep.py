"""The configuration of a sweep, `SweepConfig`, and the checks that involve several of its groups.

The names, bounds and defaults of parameters come from ``vibroimpact.oscillator.PARAMETERS``.
"""

from __future__ import annotations

import math
import re
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import yaml
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sweeps.config.checks import refuse_refinement, refuse_unstable, worst_points
from sweeps.config.groups import (
    FollowConfig,
    MethodConfig,
    OscillatorConfig,
    ParameterConfig,
    RecordConfig,
    RefineConfig,
    StartConfig,
    UnitsConfig,
    choice,
    key_list,
)
from sweeps.config.points import with_columns
from sweeps.config.rig import RigConfig, checked_units, si_name, si_values, with_rig
from sweeps.config.values import (
    Group,
    Key,
    MisplacedError,
    Table,
    as_array,
    extremes,
    length,
    null,
    one_of,
)
from sweeps.grid import TABLE, Grid
from sweeps.text import printable, shortest
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.points.scaling import scales_with_f
from vibroimpact.step.scheme import MOST_STEPS, default_steps

#: Compressions of a complete file.
COMPRESSIONS = ("none", "gzip")

# Limits that turn a typing error into a message instead of a lack of memory.
_MOST_POINTS = 1_000_000_000
_MOST_SAMPLES = 10_000_000


# The characters that a name may not have, as a part of a regular expression.
_NOT_IN_A_NAME = r"/\\\x00-\x1f\x7f-\x9f"


def _checked_name(name: object) -> object:
    """Refuse a name with a character that is not allowed; say which."""
    if isinstance(name, str) and (wrong := re.search(rf"[{_NOT_IN_A_NAME}\ud800-\udfff]", name)):
        raise ValueError(f"has the character {wrong[0]!a}, which is not allowed")
    return name


def _group(meaning: str, group: type[Group]) -> Any:
    """Return the field of a group whose keys all have a default."""
    text = f"{meaning}: {key_list(group)}"
    return Field(default_factory=group, validate_default=True, description=text)


class SweepConfig(Group):
    """A sweep of the forced oscillator with impacts, over a grid or a table of its parameters.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> config = sweeps.load_config(scene)
    >>> config.oscillator.R, config.method.impact, config.size
    (0.8, 'exact', 20)
    """

    name: Annotated[str, BeforeValidator(_checked_name)] = Field(
        "sweep",
        pattern=f"^[^{_NOT_IN_A_NAME}]+$",
        description="name of the sweep: a text without slashes and control characters "
        "(default: the name of the configuration file)",
    )
    points: Table = Field(
        None,
        description="table of the points, in place of lists and ranges: a CSV file with a header, "
        "relative to this one, or a mapping of columns, each a list; columns are named like "
        "parameters, and further ones are kept",
    )
    rig: Annotated[RigConfig | None, BeforeValidator(null)] = Field(
        None,
        description=f"a rig in SI units, in place of the oscillator: {key_list(RigConfig)}",
    )
    oscillator: OscillatorConfig = Field(
        description=f"parameters of eq. (1): {key_list(OscillatorConfig)}"
    )
    start: StartConfig = _group("state at time 0", StartConfig)
    method: MethodConfig = _group("how to compute", MethodConfig)
    record: RecordConfig = _group("what to keep", RecordConfig)
    follow: Annotated[FollowConfig | None, BeforeValidator(null)] = Field(
        None,
        description="start each point along an axis from its neighbour's final state: "
        f"{key_list(FollowConfig)}, or null",
    )
    refine: Annotated[RefineConfig | None, BeforeValidator(null)] = Field(
        None,
        description="add points where the class of the motion changes: "
        f"{key_list(RefineConfig)}, or null",
    )
    units: Annotated[UnitsConfig, AfterValidator(checked_units)] = _group(
        "names of the units, for axes and attributes; no number is converted; with a rig always "
        "m, s and kg",
        UnitsConfig,
    )
    output: Path = Field(
        Path("sweep.h5"), description="HDF5 file to write: a path (default: <name>.h5)"
    )
    compression: Annotated[str, one_of(COMPRESSIONS)] = choice(
        "compression of the complete file", COMPRESSIONS, "none"
    )

    @model_validator(mode="before")
    @classmethod
    def _completed(cls, data: Any) -> Any:
        """Name the output after the sweep, and insert the parameters of a rig or a table."""
        if not isinstance(data, dict):
            return data
        if "name" in data and "output" not in data:
            data = {**data, "output": f"{data['name']}.h5"}
        data = data if null(data.get("rig")) is None else with_rig(data)
        return with_columns(data) if isinstance(data.get("points"), np.ndarray) else data

    @field_validator("oscillator", mode="wrap")
    @classmethod
    def _of_the_rig(cls, given: Any, handler: Any, info: ValidationInfo) -> Any:
        """Take the parameters of the oscillator from the rig, if a valid one is given."""
        if "rig" not in info.data:
            return None
        rig = info.data["rig"]
        return handler(given if rig is None else rig.oscillator())

    @field_validator("start")
    @classmethod
    def _fits_the_oscillator(cls, start: StartConfig, info: ValidationInfo) -> StartConfig:
        """Refuse starts beyond the stop, and grids of too many points."""
        oscillator = info.data.get("oscillator")
        if oscillator is None:
            return start  # the oscillator has been refused already
        x0, clearance, where = max(extremes(start.x0)), min(extremes(oscillator.clearance)), ""
        if info.data.get("points") is not None:
            pairs = np.broadcast_arrays(as_array(start.x0), as_array(oscillator.clearance))
            row = int(np.argmax(pairs[0] > pairs[1]))
            x0, clearance, where = *(end[row] for end in pairs), f"row {row + 1} of points: "
        if x0 > clearance:
            typed, stop = "x0" in start.model_fields_set, si_name("clearance", info.data["rig"])
            raise MisplacedError(
                ("start", "x0") if typed else ("oscillator", "clearance"),
                f"{where}x0 = {shortest(x0)} lies beyond the stop at {stop} = "
                f"{shortest(clearance)}; every x0 must be <= every {stop}",
            )
        lengths: dict[Key, int] = {
            (title, name): length(value)
            for title, group in (("oscillator", oscillator), ("start", start))
            for name, value in group.items()
        }
        points = math.prod(lengths.values())
        if points > _MOST_POINTS:
            raise MisplacedError(
                max(lengths, key=lambda key: lengths[key]),
                f"the axes make a grid of {points:,} points; expected: at most {_MOST_POINTS:,}",
            )
        return start

    @field_validator("method")
    @classmethod
    def _enough_steps(cls, method: MethodConfig, info: ValidationInfo) -> MethodConfig:
        """Refuse too few steps per period; choose the number if none is given."""
        oscillator, steps = info.data.get("oscillator"), method.steps_per_period
        if oscillator is None:
            return method
        points = worst_points(oscillator, method.integrator)
        try:
            needed = default_steps(points, method.impact, method.integrator)
        except ValueError as error:
            raise MisplacedError(("oscillator", "omega"), str(error)) from None
        if steps is not None and method.impact == "exact" and steps < needed:
            raise MisplacedError(
                ("method", "steps_per_period"),
                f"{steps} are not enough for exact impacts here; "
                f"expected: an integer from {needed} to {MOST_STEPS}, or null",
            )
        if not method.allow_unstable:
            refuse_unstable(method.integrator, steps or needed, points)
        return method.model_copy(update={"steps_per_period": steps or needed})

    @field_validator("record")
    @classmethod
    def _can_be_recorded(cls, record: RecordConfig, info: ValidationInfo) -> RecordConfig:
        """Refuse Lyapunov exponents without exact impacts, and trajectories of too many samples."""
        method = info.data.get("method")
        if method is None or info.data.get("oscillator") is None:
            return record
        if "lyapunov" in record.diagnostics and method.impact != "exact":
            raise MisplacedError(
                ("record", "diagnostics"),
                f"lyapunov needs the impact rule exact, not {method.impact}; "
                "expected: method.impact: exact, or diagnostics without lyapunov",
            )
        samples = 0
        if record.trajectory:
            samples = record.periods * method.steps_per_period // record.trajectory.every + 1
        if samples > _MOST_SAMPLES:
            raise MisplacedError(
                ("record", "trajectory"),
                f"{samples:,} samples per point are too many; expected: at most {_MOST_SAMPLES:,}",
            )
        return record

    @field_validator("follow", "refine")
    @classmethod
    def _has_neighbours(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse to follow or refine a table, which has no axis."""
        if value is not None and info.data.get("points") is not None:
            problem = "needs an axis, but points has none; expected: a range instead of points"
            raise MisplacedError((str(info.field_name),), problem)
        record = info.data.get("record")
        if value is not None and record is not None and record.transient is None:
            problem = f"auto cannot be used with {info.field_name}; expected: an integer"
            raise MisplacedError(("record", "transient"), problem)
        return value

    @field_validator("follow")
    @classmethod
    def _along_an_axis(cls, follow: FollowConfig | None, info: ValidationInfo) -> Any:
        """Refuse to follow an axis that is not swept."""
        if follow is None or info.data.get("oscillator") is None:
            return follow
        lengths = {name: length(value) for name, value in info.data["oscillator"].items()}
        if lengths[follow.axis] < 2:
            rig = info.data["rig"]
            swept = [si_name(name, rig) for name, number in lengths.items() if number > 1]
            raise MisplacedError(
                ("follow", "axis"),
                f"{si_name(follow.axis, rig)} has only one value, so that there is nothing to "
                "follow; expected: "
                + (f"a swept axis out of {', '.join(swept)}" if swept else "an axis that is swept"),
            )
        return follow

    @model_validator(mode="after")
    def _can_be_refined(self) -> Self:
        if self.refine is not None:
            name, axes = si_name(self.refine.axis, self.rig), si_values(self.grid.axes, self.rig)
            refuse_refinement(name, axes, self.method, self.record, self.follow)
        return self

    def with_record(self, **changes: object) -> Self:
        """Return a copy of the sweep with changes to ``record``, and with empty caches."""
        record = self.record.model_copy(update=changes)
        made = type(self).model_construct(**{**dict(self), "record": record})
        made._order = self._order
        return made

    @property
    def steps(self) -> int:
        """Steps per forcing period, the same for all points."""
        steps = self.method.steps_per_period
        assert steps is not None  # `_enough_steps` has chosen a number if none was given
        return steps

    @property
    def integration(self) -> dict[str, Any]:
        """Integrator, impact rule and steps per period: keyword arguments of `integrate`."""
        method = self.method
        names = {"integrator": method.integrator, "impact": method.impact}
        return {**names, "steps_per_period": self.steps}

    @cached_property
    def spec(self) -> RunSpec:
        """The quantities to compute for every point, and the method."""
        record, follow = self.record, self.follow
        return RunSpec(
            **self.integration,
            transient=record.left_out,
            longest=record.most_left_out if record.transient is None else None,
            periods=record.periods,
            phase=record.phase,
            impacts=record.impacts,
            lyapunov="lyapunov" in record.diagnostics,
            period="period" in record.diagnostics,
            every=record.trajectory.every if record.trajectory else None,
            scaled=follow is None and scales_with_f(self.grid.swept, self.grid.fixed),
            followed=follow.axis if follow else None,
            directions=self.directions,
        )

    @cached_property
    def grid(self) -> Grid:
        """The swept axes in the order of the file, or the table, with the fixed values."""
        axes: dict[str, np.ndarray] = {} if self.points is None else {TABLE: self.points}
        fixed: dict[str, float] = {}
        for title in dict.fromkeys("oscillator" if t == "rig" else t for t, _ in self.items()):
            group = getattr(self, title)
            if isinstance(group, ParameterConfig):
                for name, value in group.items():
                    if isinstance(value, float):
                        fixed[name] = value
                    elif self.points is None:
                        axes[name] = as_array(value)
        return Grid(axes, fixed)

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions in which an axis is followed; empty if none is followed."""
        if self.follow is None:
            return ()
        return ("up", "down") if self.follow.direction == "both" else (self.follow.direction,)

    @property
    def size(self) -> int:
        """Number of points to compute, counting each direction of a followed axis."""
        return self.grid.size * max(1, len(self.directions))

    def to_yaml(self, *, table: bool = True, ascii: bool = False) -> str:
        """Return the configuration as YAML with all defaults, without output and compression.

        Loading it gives the same sweep: the same values and steps, and the axes in the same order.
        With ``table=False`` the table of points is left out. With ``ascii=True`` all other
        characters are escaped.

        >>> import sweeps
        >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
        >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
        >>> print(sweeps.load_config(scene).to_yaml().splitlines()[0])
        oscillator:
        """
        plain = _plain(self)
        if self.points is None or not table:
            del plain["points"]
        del plain["output"], plain["compression"]
        del plain["rig" if self.rig is None else "oscillator"]
        if plain["record"]["transient"] is None:
            plain["record"]["transient"] = "auto"
        if plain["record"]["longest"] is None:
            del plain["record"]["longest"]
        for name in ("follow", "refine"):
            if plain[name] is None:
                del plain[name]
            else:
                plain[name]["axis"] = si_name(plain[name]["axis"], self.rig)
        if self.rig is None:
            del plain["units"]["mass"]
        if self.units == UnitsConfig():
            del plain["units"]
        options: dict[str, Any] = {"sort_keys": False, "default_flow_style": None}
        text: str = yaml.safe_dump(plain, **options, allow_unicode=not ascii)
        # Escape control characters, which a terminal would obey; YAML reads both forms alike.
        return text if printable(text) == text else yaml.safe_dump(plain, **options)


def _plain(value: Any) -> Any:
    """Convert a value to YAML's types: groups become mappings in the order of their keys."""
    if isinstance(value, Group):
        return {
            name: _plain(item)
            for name, item in value.items()
            if not (isinstance(item, np.ndarray) and item.dtype.names is None)  # of the table
        }
    if isinstance(value, np.ndarray):
        return {name: value[name].tolist() for name in value.dtype.names or ()}
    return list(value) if isinstance(value, tuple) else value

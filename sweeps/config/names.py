"""Names that people type for a key of the configuration, and the key that they mean."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from sweeps.text import nearest

#: Other names of each key: symbols of the literature, words of other programs.
_OTHER_NAMES = {
    "oscillator": "parameters params system model",
    "start": "initial initial_conditions initial_state ic",
    "method": "numerics integration",
    "record": "save store recording keep",
    "follow": "continuation continue",
    "refine": "refinement adaptive",
    "output": "out file filename path hdf5",
    "h": "damping damping_ratio damping_coefficient zeta xi c friction viscous",
    "R": "restitution coefficient_of_restitution restitution_coefficient cor e rebound",
    "omega": "frequency freq forcing_frequency excitation_frequency angular_frequency w",
    "f": "amplitude forcing_amplitude forcing force excitation f0",
    "p": "eigenfrequency natural_frequency omega0 omega_0 omega_n stiffness k",
    "clearance": "gap sigma delta distance play backlash offset wall barrier obstacle",
    "x0": "x x_0 position displacement",
    "v0": "v v_0 velocity speed",
    "integrator": "scheme solver",
    "impact": "rule impact_rule collision",
    "steps_per_period": "steps step time_step timestep dt",
    "transient": "transients skip discard warmup burn_in",
    "periods": "cycles n_periods duration",
    "trajectory": "time_series samples",
    "diagnostics": "quantities compute",
    "axis": "parameter along",
    "levels": "depth",
    "num": "n count number points steps size",
    "spacing": "scale",
}
#: Other names of `start` and `stop` in a range; elsewhere these words mean other things.
_OTHER_ENDS = {"start": "from min low lower begin first", "stop": "to max high upper end last"}


def meant(name: str, valid: Collection[str], elsewhere: Iterable[str] = ()) -> str | None:
    """Return the key meant by a name that is not a key.

    Parameters
    ----------
    name : str
        As it was typed.
    valid : collection of str
        The keys that may stand there.
    elsewhere : iterable of str
        Other keys of the configuration, dotted.

    Returns
    -------
    str or None
        The key of `valid` that has this name in another case, as another name or but for a letter;
        else such a key of `elsewhere`; else the key of `valid` that is spelt most alike.
    """
    folded = name.casefold().replace("-", "_").replace(" ", "_")
    ends = _OTHER_ENDS if {"start", "stop", "num"} <= {*valid} else {}
    last = {key.rpartition(".")[2]: key for key in elsewhere}
    here = {
        word: key
        for key in valid
        for word in (key.casefold(), *ends.get(key, _OTHER_NAMES.get(key, "")).split())
    }
    anywhere = {
        word: last[key]
        for key in last
        for word in (key.casefold(), *_OTHER_NAMES.get(key, "").split())
    }
    return (
        here.get(folded)
        or nearest(name, valid, least=0.85)
        or anywhere.get(folded)
        or nearest(name, valid)
    )

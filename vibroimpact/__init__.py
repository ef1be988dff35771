"""A forced oscillator with impacts: exact facts, integrators, impact rules and the sweep kernel."""

from vibroimpact.oscillator import Oscillator

__all__ = ["Oscillator"]

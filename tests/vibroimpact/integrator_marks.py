"""Tests over the integrators."""

import pytest

from vibroimpact.step.integrators import INTEGRATORS

ALL = pytest.mark.parametrize("integrator", INTEGRATORS)

# For what a rule does with short flights: a first-order step sees none that is shorter than it.
SECOND_ORDER = pytest.mark.parametrize(
    "integrator", [name for name, row in INTEGRATORS.items() if row.order != 1]
)

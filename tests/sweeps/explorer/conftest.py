"""The view of the live picture that its tests begin with."""

import pytest

from sweeps import load_config
from sweeps.explorer.view import View
from tests.helpers.places import CONFIGS


@pytest.fixture
def view():
    """Return the view of the scene quickstart."""
    return View.of(load_config(CONFIGS / "quickstart.yaml"))

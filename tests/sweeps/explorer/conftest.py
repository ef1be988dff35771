"""A browser, the view that the live picture begins with, and its page without a browser."""

import pytest
from bokeh.document import Document

from sweeps import load_config
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.view import View
from tests.helpers.browser import chromium
from tests.helpers.places import CONFIGS


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def view():
    """Return the view of the scene quickstart."""
    return View.of(load_config(CONFIGS / "quickstart.yaml"))


@pytest.fixture
def page_of(tmp_path):
    """Return a function that makes the page of a view."""
    pages = []

    def make(view):
        pages.append(LivePage(Document(), view, tmp_path))
        return pages[-1]

    yield make
    for page in pages:
        page.worker.shutdown()

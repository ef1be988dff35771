"""The tests. Helpers are imported as ``from tests.helpers.NAME import ...``."""

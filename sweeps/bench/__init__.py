"""Measurements of the methods, with SciPy and heyoka for comparison."""

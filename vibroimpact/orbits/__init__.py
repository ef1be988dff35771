"""Periodic orbits, stable or not: branches, and curves of bifurcations."""

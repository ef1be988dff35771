"""Periodic orbits: one-impact orbits in closed form, shooting, period classes."""

"""Periodic orbits, their branches and bifurcation curves; one-impact orbits in closed form."""

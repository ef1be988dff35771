"""One step of one orbit: the exact map, impacts, rest, integrators."""

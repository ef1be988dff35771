"""One step of one orbit: flight, stop, integrators, impact rules, tangent vectors, stability."""

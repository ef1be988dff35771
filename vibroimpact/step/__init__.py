"""One orbit, step by step: flight, stop, integrators, impact rules, tangents, stability, log."""

"""One orbit, step by step: contact, flight, impact, integrators, tangent vectors, recorder."""

"""The attractors of an opened sweep: their starts, numbers and integrity."""

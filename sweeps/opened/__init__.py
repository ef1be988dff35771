"""An opened sweep as its user reads it: its axes, coordinates, motions and tables, in its units."""

"""An opened sweep: cuts, coordinates, SI units, motions, tables."""

"""The attractors of an opened sweep: which starts reach them, their basins, and what ends them."""

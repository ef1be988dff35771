"""The bifurcations of an opened sweep: changes of class, exact branches, and exact curves."""

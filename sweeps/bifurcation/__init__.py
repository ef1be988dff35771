"""Changes of class and their bifurcations; exact branches and curves."""

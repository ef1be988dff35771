"""Reports of the commands: the data of a sweep and of its analyses as text."""

"""Reports of the commands: a run and its file as text."""

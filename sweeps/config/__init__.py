"""YAML to a checked `SweepConfig`, with the line of every key."""

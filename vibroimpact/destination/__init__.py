"""Where motions go: the periodic orbit that each approaches, with the evidence that it does."""

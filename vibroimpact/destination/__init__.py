"""Where each of many motions goes, and the evidence that it does."""

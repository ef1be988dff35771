"""Measurements of the methods themselves: accuracy, speed and stability, each from runs."""

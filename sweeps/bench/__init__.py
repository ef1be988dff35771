"""Measurements of the methods: accuracy, speed and stability, all from runs."""

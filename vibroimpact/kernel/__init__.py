"""The steps of many points side by side."""

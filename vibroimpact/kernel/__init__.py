"""The steps of many points side by side: workspace, loops, records and threads."""

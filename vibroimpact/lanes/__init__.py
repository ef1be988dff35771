"""The same step for many points side by side: workspace, loops, records, threads."""

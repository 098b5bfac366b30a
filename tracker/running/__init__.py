"""Running: commands and jobs, drafts of configurations, many recordings at a time, the viewer.

Only `cli` and `commands` print and exit. It imports every room; no room imports it.
"""

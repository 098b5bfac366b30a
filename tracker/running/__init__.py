"""Running: commands and jobs, what a configuration asks for, many recordings at a time, a run that is looked at.

Here alone is printed and exited (`cli`, `commands`). It imports every room; nobody imports it.
"""

"""Configurations: components from TOML tables and back, their files, their schemas, components from outside.

`components` finds a component: a section has the name of a folder, `use` names a file in it. Every room may import it.
"""

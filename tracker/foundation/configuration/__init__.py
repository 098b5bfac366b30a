"""Configurations: TOML tables made into components and back, their files, their schemas, components from outside.

`components` finds a component: a section is called like a folder, `use` names a file in it. Everybody may import it.
"""

"""The base of every room: errors, arrays, geometry, files as a whole or not at all, progress, configuration.

It knows nothing of cameras, bodies or images. Every room may import it; it imports no other room.
"""

"""What every room stands on: errors, arrays, geometry, files as a whole or not at all, progress, configuration.

It knows nothing of cameras, bodies or images. Everybody may import it; it imports no other room.
"""

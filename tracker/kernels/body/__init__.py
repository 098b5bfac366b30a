"""Forward kinematics and collisions of parts, for `tracker.body`."""

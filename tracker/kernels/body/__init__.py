"""Forward kinematics and collisions of parts, for `tracker.kinematic_tree` and `tracker.body`."""

"""Forward kinematics and collisions of parts, for `tracker.body.kinematic_tree` and `tracker.body`."""

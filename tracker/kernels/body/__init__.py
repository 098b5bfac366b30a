"""Forward kinematics and collisions of parts, for `tracker.bodies.body.kinematic_tree` and `tracker.bodies.body`."""

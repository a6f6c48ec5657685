"""Motion of a single finger: inverse kinematics, waypoints and obstructions."""

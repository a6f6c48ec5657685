"""Several distinct grasps of one solve, each certified."""

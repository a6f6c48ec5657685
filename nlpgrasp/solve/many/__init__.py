"""Many grasps of one solve: the distinct ones of its starts and of what it met besides, each certified."""

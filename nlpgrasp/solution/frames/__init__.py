"""A solution in the frame of a world."""

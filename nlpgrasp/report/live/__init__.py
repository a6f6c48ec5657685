"""Interactive viewer of a grasp by a local server: sliders for task wrenches, finger forces and the hand."""

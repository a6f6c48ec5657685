"""The phases of a grasp by a hand, and the trajectory through them."""

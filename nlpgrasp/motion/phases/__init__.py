"""Phases of a grasp by hand: approach, pregrasp, grasp, squeeze, lift."""

"""Phases of a grasp by a hand: keyframes and trajectory."""

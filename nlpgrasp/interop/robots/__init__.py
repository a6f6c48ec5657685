"""Grasps for the programs that move robots: what a hand does before, in and after closing, in their formats."""

"""Grasp force optimisation: least finger forces for given wrenches."""

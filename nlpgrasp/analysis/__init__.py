"""Analyses of a solution: shadow prices, infeasibility, squeeze, sensitivity, manipulability."""

"""Budgets bound to a grasp: sets of finger forces in the contacts' frames."""

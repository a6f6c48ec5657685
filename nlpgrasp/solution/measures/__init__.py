"""Quality measures of a solution: certified quality, forces and bounds."""

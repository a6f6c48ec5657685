"""What a solution states about how good its grasp is: quality, forces, bounds."""

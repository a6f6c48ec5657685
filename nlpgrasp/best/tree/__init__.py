"""Branch and bound over placements."""

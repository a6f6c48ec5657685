"""Independent verification of global upper bounds by recomputed leaves that cover all placements."""

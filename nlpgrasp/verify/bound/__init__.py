"""Independent verification of global upper bounds: recomputed leaves that together cover all placements."""

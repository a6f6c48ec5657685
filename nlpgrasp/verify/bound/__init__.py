"""Independent verification of global upper bounds: leaves recomputed, and shown to cover all placements."""

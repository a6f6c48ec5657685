"""Bounds on mu over cells of the surface, from mixtures of directions."""

"""Bounds on mu from mixtures of directions."""

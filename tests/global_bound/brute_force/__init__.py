"""Brute-force search over placements of random problems."""

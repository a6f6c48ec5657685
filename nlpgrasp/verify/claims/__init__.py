"""Checks of a file's claims: quality, optimality, outcome, forces, hand and drawing."""

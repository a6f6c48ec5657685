"""Pieces of a body's surface that a contact may lie on, and how they are cut in two."""

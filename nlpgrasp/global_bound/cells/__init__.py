"""Cells of a body's faces for branch and bound: subdivisions of the surface."""

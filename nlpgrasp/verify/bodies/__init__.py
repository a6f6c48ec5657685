"""Numeric bodies from JSON data: surfaces, normals and signed distances in closed form."""

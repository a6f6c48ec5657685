"""Bodies as numbers: surfaces, normals and distances in closed form, from JSON data alone."""

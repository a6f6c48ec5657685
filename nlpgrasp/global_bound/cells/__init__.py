"""Surface cells for branch and bound: subdivisions of a body's faces."""

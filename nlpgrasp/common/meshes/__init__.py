"""Triangle meshes: reading, repair, search trees, intersections, mass properties."""

"""Triangle meshes: reading, repair, union, search trees, mass properties."""

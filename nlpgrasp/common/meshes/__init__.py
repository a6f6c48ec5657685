"""Triangle meshes: reading them, and their search trees."""

"""Links as spheres: fitted, kept apart."""

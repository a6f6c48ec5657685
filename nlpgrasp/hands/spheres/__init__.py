"""Collision spheres of links: fitting, self-collision and fingertip clearance."""

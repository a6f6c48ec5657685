"""What shapes of bodies share: a place about the origin, and surfaces as triangles whose vertices are on the body."""

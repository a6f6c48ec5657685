"""Task ellipsoids fitted to recorded wrenches."""

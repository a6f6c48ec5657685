"""Storage utilities: cache, file locks, strict JSON."""

"""Optional dependencies, imported on demand."""

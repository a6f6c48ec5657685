"""Solutions transformed to a world frame."""

"""Tasks from recorded wrenches."""

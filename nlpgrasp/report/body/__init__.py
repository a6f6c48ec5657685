"""HTML page of a body."""

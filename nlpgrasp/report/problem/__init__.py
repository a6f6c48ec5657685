"""HTML page of a problem."""

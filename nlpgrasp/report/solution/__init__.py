"""HTML page and pictures of solutions."""

"""A page and pictures of solutions."""

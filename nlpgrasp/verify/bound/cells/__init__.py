"""Numeric cells of a global bound, from their JSON data."""

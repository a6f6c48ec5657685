"""Hands as numbers: their rows, and where their links are, from JSON data and their own file."""

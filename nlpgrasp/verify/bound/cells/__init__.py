"""Numeric twins of the cells that a bound is made of, from their JSON data alone."""

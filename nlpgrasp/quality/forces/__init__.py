"""Least finger forces for wrenches."""

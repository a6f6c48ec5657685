"""Hands from URDF files."""

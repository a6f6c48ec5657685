"""Shared geometry of bodies: centred bodies and triangulated surfaces."""

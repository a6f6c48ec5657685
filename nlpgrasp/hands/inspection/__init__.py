"""Inspection of a hand before any solve: fingertip opposition and warnings about its file."""

"""Paths of contacts over a body's surface, and their execution by a finger."""

"""Paths over a body, and how a finger takes them."""

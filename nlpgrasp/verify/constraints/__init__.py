"""Numeric constraints: recomputed values for stated contacts and hand."""

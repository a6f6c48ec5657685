"""Constraints as numbers: the rows that each gives for stated contacts and hand."""

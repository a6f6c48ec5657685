"""Starts of the multistart search: initial candidates, initial NLP, refinement, warm starts."""

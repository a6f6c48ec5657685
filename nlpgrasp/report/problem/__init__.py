"""The page of a problem."""

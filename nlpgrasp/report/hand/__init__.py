"""HTML page of a hand before any solve."""

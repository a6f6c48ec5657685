"""A hand on a page of its own, before anything is solved with it."""

"""One start: screen, first program, touch."""

"""From the solver's surface onto the body itself."""

"""A problem as people see it before it is solved."""

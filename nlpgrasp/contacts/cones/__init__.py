"""Force domains in closed form: projections and supports."""

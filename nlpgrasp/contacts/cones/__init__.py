"""Force domains: projections and supports, in closed form or to rounding."""

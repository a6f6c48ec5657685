"""Force sets: budgets intersected with the force domains of given contacts."""

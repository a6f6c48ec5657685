"""What proposes the steps of an ascent: the nonlinear program, its linearisation, and those registered."""

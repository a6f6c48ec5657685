"""Trust-region steps of the local search, by the nonlinear program or its linearisation."""

"""Local search: maximisation of mu by cutting planes in a trust region."""

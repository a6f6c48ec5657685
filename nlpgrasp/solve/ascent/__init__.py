"""The exchange: mu itself, maximised with cutting planes in a trust region."""

"""The ascent: mu itself, maximised with cutting planes in a trust region."""

"""Choice of number and types of contacts by solves with shared warm starts."""

"""What an experiment asks: a base problem and its variations."""

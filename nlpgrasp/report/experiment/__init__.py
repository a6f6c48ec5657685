"""A page and plots of an experiment."""

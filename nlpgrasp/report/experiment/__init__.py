"""HTML page and plots of an experiment."""

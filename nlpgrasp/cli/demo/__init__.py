"""The command ``nlpgrasp demo``."""

"""The command ``nlpgrasp hand``."""

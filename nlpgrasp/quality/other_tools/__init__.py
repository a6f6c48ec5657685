"""Quality measures of other tools, for comparison."""

"""Results of an experiment: records, comparisons and tables."""

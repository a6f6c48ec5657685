"""What an experiment found: records, comparisons, tables."""

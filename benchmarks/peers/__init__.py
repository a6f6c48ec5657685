"""Comparison study of the package with other methods: ``python -m benchmarks.peers``."""

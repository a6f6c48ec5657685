"""The package beside what one would use instead: ``python -m benchmarks.peers``."""

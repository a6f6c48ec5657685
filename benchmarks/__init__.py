"""Benchmarks of speed and quality (``make bench``); ratios are of times in the same run on the same machine."""

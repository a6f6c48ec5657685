"""Benchmarks of speed and quality (``make bench``).

Ratios compare times of the same run on the same machine.
"""

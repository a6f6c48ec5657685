"""Specification of an experiment: base problem, variations and seeds."""

"""Certified bounds on mu: polytopes inside and out."""

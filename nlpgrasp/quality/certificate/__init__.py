"""Certified bounds on mu by inner and outer approximation of the wrench set."""

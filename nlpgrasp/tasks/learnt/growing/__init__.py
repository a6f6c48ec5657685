"""Ellipsoids that grow with what is recorded, without a second look at every wrench of before."""

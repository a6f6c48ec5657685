"""Conversion of user input: lengths with units, angles, masses, names, poses."""

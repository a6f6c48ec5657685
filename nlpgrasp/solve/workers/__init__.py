"""Starts over processes, stops and interrupts."""

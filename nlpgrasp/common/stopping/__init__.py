"""Cancellation by deadlines and Ctrl-C."""

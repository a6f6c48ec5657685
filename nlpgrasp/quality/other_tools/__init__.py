"""Measures as other tools compute them."""

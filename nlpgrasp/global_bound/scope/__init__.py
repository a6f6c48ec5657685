"""Scope of the bound: allowed regions of contacts, root cells, symmetries."""

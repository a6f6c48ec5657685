"""The part of a problem that the bound covers: places of contacts, cells, symmetries."""

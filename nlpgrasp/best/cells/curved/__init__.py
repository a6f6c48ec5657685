"""Cells of curved faces: contacts on a grid, and small parts between them that can be made finer."""

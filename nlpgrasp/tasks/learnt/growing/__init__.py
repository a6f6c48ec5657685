"""Incremental enclosing ellipsoids of growing sets of wrenches."""

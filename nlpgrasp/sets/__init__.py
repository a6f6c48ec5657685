"""Data sets of grasps: tables with one row per start, computed in parallel."""

"""Data sets of grasps: tables with one row per start, made in parallel and read as solutions."""

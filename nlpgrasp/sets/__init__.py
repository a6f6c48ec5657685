"""Data sets of grasps: tables with one row a start, made by many processes and read as solutions."""

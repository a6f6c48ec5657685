"""Robots from MuJoCo's own files (MJCF), as the same plain data that a URDF gives."""

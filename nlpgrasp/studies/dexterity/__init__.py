"""Manipulability and sensitivity of a grasp."""

"""Grasp formats for robot control and benchmarks: hand states before, in and after closing."""

"""Squeeze of a grasp: internal finger forces, and the joint torques and commands that exert them."""

"""What people see: the drawing of a grasp, and wrenches in words."""

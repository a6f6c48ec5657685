"""What people see: the drawing of a grasp, wrenches in words, lines of text."""

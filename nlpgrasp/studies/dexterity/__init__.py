"""What the hand can do with the body in a grasp, and how much the grasp depends on where everything is."""

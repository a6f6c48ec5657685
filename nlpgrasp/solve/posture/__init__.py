"""The posture of a hand in a grasp that was found."""

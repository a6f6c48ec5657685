"""Joint-limit margins of a hand's posture in a grasp."""

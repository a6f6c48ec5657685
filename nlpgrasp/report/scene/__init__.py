"""3D scene of a grasp for the page's viewer."""

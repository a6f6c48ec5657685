"""Several grasps of one problem: each with its quality and forces, and the choice among them."""

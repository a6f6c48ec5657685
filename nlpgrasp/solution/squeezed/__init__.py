"""A grasp's squeeze: balanced finger forces, and the joint torques and commands that exert them."""

"""A grasp on a page of this computer that Python answers: sliders over task wrenches, finger forces and the hand."""

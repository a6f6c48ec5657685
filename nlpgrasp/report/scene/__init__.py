"""The grasp in three dimensions: what the page's viewer draws."""

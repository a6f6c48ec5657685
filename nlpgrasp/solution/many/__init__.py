"""Several grasps of one problem: records, and selection by a user's function."""

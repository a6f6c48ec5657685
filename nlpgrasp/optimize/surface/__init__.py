"""Grasps on the body itself: projection of contacts and hands from a mesh's smooth surface onto the mesh."""

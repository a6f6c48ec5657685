"""A finger on its path: its joints, its waypoints, and what stops it."""

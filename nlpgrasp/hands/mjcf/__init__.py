"""MJCF reader: robot descriptions from MuJoCo's model files."""

"""Motion of hands: clearances, straight paths, approach, keyframes, palm path, finger motion."""

"""Motion of hands: clearances, straight paths, approach, phases, palm path, finger motion."""

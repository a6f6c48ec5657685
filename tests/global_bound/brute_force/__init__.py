"""Random problems, random placements of theirs and the best that chance and small moves find among these."""

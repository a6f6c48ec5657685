"""An independent check of bounds over all placements: every leaf computed again, and that leaves cover them all."""

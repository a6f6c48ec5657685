"""Clearance of a hand: distances of its links from the body, surroundings and each other."""

from nlpgrasp.motion.space.surroundings import Surroundings

__all__ = ["Surroundings"]

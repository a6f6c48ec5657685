"""The room a hand has: how far its links are from the body, from what is in the way and from each other."""

from nlpgrasp.solve.space.surroundings import Surroundings

__all__ = ["Surroundings"]

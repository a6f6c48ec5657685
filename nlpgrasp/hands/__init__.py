"""Hands: by whom the body is held."""

from nlpgrasp.hands.base import Hand, HandVariable
from nlpgrasp.hands.fingertips import Fingertips

__all__ = ["Fingertips", "Hand", "HandVariable"]

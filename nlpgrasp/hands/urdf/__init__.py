"""Hands from URDF files."""

from nlpgrasp.hands.urdf.urdf_hand import URDFHand

__all__ = [
    "URDFHand",
]

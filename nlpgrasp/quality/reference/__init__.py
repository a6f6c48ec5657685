"""Reference implementations of the paper's algorithms (Sections 3.1 and 3.4)."""

from nlpgrasp.quality.reference.distance import PolytopeDistance, polytope_distance
from nlpgrasp.quality.reference.faces import InscribedPolytope, inscribed_polytope
from nlpgrasp.quality.reference.steps import SteppedMu, mu_by_steps

__all__ = [
    "InscribedPolytope",
    "PolytopeDistance",
    "SteppedMu",
    "inscribed_polytope",
    "mu_by_steps",
    "polytope_distance",
]

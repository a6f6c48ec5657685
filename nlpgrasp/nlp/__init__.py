"""The symbolic program: named blocks, two transcriptions of containment, IPOPT."""

from nlpgrasp.nlp.blocks import Block
from nlpgrasp.nlp.compile import CompiledProgram, NlpResult
from nlpgrasp.nlp.placement import Scaling, face_parameters
from nlpgrasp.nlp.program import HAND, Program
from nlpgrasp.nlp.support import SUPPORT, has_closed_form, has_pieces, support_program
from nlpgrasp.nlp.vertex import vertex_program
from nlpgrasp.nlp.virtual_work import VirtualWork

__all__ = [
    "HAND",
    "SUPPORT",
    "Block",
    "CompiledProgram",
    "NlpResult",
    "Program",
    "Scaling",
    "VirtualWork",
    "face_parameters",
    "has_closed_form",
    "has_pieces",
    "support_program",
    "vertex_program",
]

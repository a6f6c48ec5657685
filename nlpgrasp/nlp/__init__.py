"""The symbolic program: named blocks, two transcriptions of containment, IPOPT."""

from nlpgrasp.nlp.compile import CompiledProgram, NlpResult
from nlpgrasp.nlp.placement import Scaling, face_parameters
from nlpgrasp.nlp.program import Block, Program
from nlpgrasp.nlp.support import has_closed_form, has_pieces, support_program
from nlpgrasp.nlp.vertex import vertex_program
from nlpgrasp.nlp.virtual_work import VirtualWork

__all__ = [
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

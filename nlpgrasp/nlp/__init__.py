"""Nonlinear program of optimal grasping: formulation (read ``formulation.py`` first), derivatives and solver."""

from nlpgrasp.nlp.blocks import HAND, Block
from nlpgrasp.nlp.formulation import (
    SUPPORT,
    SurfaceConstraints,
    face_parameters,
    has_closed_form,
    optimal_grasp_program,
)
from nlpgrasp.nlp.formulation_result import FormulationResult
from nlpgrasp.nlp.ipopt import CompiledProgram, NlpResult
from nlpgrasp.nlp.program import Program
from nlpgrasp.nlp.public_formulation import Formulation, formulate
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.virtual_work import VirtualWork

__all__ = [
    "HAND",
    "SUPPORT",
    "Block",
    "CompiledProgram",
    "Formulation",
    "FormulationResult",
    "NlpResult",
    "Program",
    "Scaling",
    "SurfaceConstraints",
    "VirtualWork",
    "face_parameters",
    "formulate",
    "has_closed_form",
    "optimal_grasp_program",
]

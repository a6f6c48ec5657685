"""Scope of the bound: the relaxed problem that it covers, and what it omits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import comb, prod

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.scalar_constraints import EDGES
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.allowed_regions import AllowedRegion, places
from nlpgrasp.global_bound.cell_supports import Measure, Supports
from nlpgrasp.global_bound.cells.cell import CellFace
from nlpgrasp.global_bound.cells.cell_faces import surfaces
from nlpgrasp.global_bound.contact_cells import BundleLevel, ContactCells, ContactClusters, RootCells
from nlpgrasp.global_bound.symmetry import Symmetry, Turned, restrict_by_rotation, symmetries
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.tasks import Task

KINDS = ("point", "friction", "soft")  # contacts without a direction along the surface, on which curved cells rest
MOST_ROOTS = 300  # root nodes, at most: above that first cells are bundled


@dataclass(frozen=True)
class BoundScope:
    """Relaxed problem of the bound: placements of contacts in their own allowed regions, for the task.

    Parameters
    ----------
    problem : GraspProblem
    task : Task
        About the problem's torque origin.
    measure : Measure
    pieces : tuple of ContactCells
        Of contacts that are alike; together they have a slot for each contact.
    symmetries : tuple of Symmetry
        But for the identity.
    dropped : tuple of str
        What only lowers mu and is left out, each in a few words.
    """

    problem: GraspProblem
    task: Task
    measure: Measure
    pieces: tuple[ContactCells, ...]
    symmetries: tuple[Symmetry, ...]
    dropped: tuple[str, ...]

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres, body frame."""
        return self.problem.origin

    @cached_property
    def groups(self) -> tuple[tuple[ContactCells, slice], ...]:
        """The pieces with the slots of nodes that they have."""
        ends = np.cumsum([0] + [len(pieces.slots) for pieces in self.pieces]).tolist()
        return tuple((pieces, slice(*where)) for pieces, where in zip(self.pieces, pairwise(ends), strict=True))

    @cached_property
    def group_of(self) -> tuple[tuple[ContactCells, slice], ...]:
        """Of each slot of nodes the pieces, and the slots that these have."""
        return tuple(group for group in self.groups for _ in group[0].slots)

    @property
    def complete(self) -> bool:
        """Whether nothing was omitted that couples contacts."""
        return set(self.dropped) <= {EDGES}

    @property
    def slots(self) -> tuple[int, ...]:
        """Contacts in the order in which nodes have them."""
        return tuple(slot for pieces in self.pieces for slot in pieces.slots)


def scope_of(problem: GraspProblem) -> BoundScope:
    """Return what the bound covers of a problem.

    A tree begins with a node for each choice of first cells. Where these would be too many, the cells of a face are one
    to begin with, or all that a contact may touch.

    Raises
    ------
    InputError
        On a body, a contact model or a force budget that the bound does not cover.
    """
    measure, faces = _check_coverage(problem)
    own, dropped = _relaxed_parts(problem)
    turned = restrict_by_rotation(problem, faces, own)
    for bundled in BundleLevel:
        made = _create_cells(problem, faces, own, measure, bundled, turned)
        same = symmetries(problem.body, problem.task, problem.origin, made)
        choices = prod(comb(len(pieces.roots) + len(pieces.slots) - 1, len(pieces.slots)) for pieces in made)
        if choices <= MOST_ROOTS * (1 + len(same)):
            break
    return BoundScope(problem, problem.task, measure, tuple(made), tuple(same), dropped)


def whole_scope(problem: GraspProblem) -> BoundScope:
    """Return what the bound covers of a problem, all places of a contact as one cell, without its symmetries.

    Raises
    ------
    InputError
        As ``scope_of``.
    """
    measure, faces = _check_coverage(problem)
    own, dropped = _relaxed_parts(problem)
    made = _create_cells(problem, faces, own, measure, BundleLevel.ALL, [])
    return BoundScope(problem, problem.task, measure, tuple(made), (), dropped)


def _relaxed_parts(problem: GraspProblem) -> tuple[list[AllowedRegion], tuple[str, ...]]:
    """Return the places of each contact, and what of the problem the bound leaves out: of a mesh its margin too."""
    own, dropped, _ = places(problem)
    near_edges = isinstance(problem.body, Mesh) and problem.margin > 0.0
    return own, (*dropped, EDGES) if near_edges else dropped


def _check_coverage(problem: GraspProblem) -> tuple[Measure, Sequence[CellFace]]:
    """Return how supports add up, and the faces of the body; refuse what the bound does not cover."""
    measure, faces = Measure.of(problem.budget), surfaces(problem.body, problem.margin)
    if faces is None:
        raise InputError("best_possible.body", problem.body.kind, "a body of flat faces, a round one or a mesh")
    for i, contact in enumerate(problem.models):
        if contact.kind not in KINDS:
            raise InputError(f"contacts[{i}]", contact.kind, "point, friction or soft contacts for a global bound")
    return measure, faces


def _create_cells(
    problem: GraspProblem,
    faces: Sequence[CellFace],
    own: Sequence[AllowedRegion],
    measure: Measure,
    bundled: BundleLevel,
    turned: Sequence[Turned],
) -> list[ContactCells]:
    """Return the pieces of contacts that are alike; each that can be turned to a line has its own."""
    made, kind = list[ContactCells](), ContactClusters if isinstance(problem.body, Mesh) else ContactCells
    for slots in alike(problem, own):
        given = [([slot], RootCells(turned[slot][1], turned[slot][0])) for slot in slots if slot < len(turned)]
        rest = [slot for slot in slots if slot >= len(turned)]
        if rest:
            left = [own[rest[0]].allowed.clip_face(face) for face in faces if face.name in own[rest[0]].faces]
            given.append((rest, RootCells({face: face.cells() for face in left if face is not None}, None, bundled)))
        for some, roots in given:
            supports = Supports(problem.models[some[0]], measure, problem.origin)
            made.append(kind(some, roots, own[some[0]].allowed, supports, problem.body.size))
            if not made[-1].roots:
                allowed = "constraints that leave every contact some part of the body"
                raise InputError("GraspProblem.constraints", f"no place left for contact {some[0]}", allowed)
    return made


def alike(problem: GraspProblem, own: Sequence[AllowedRegion]) -> list[list[int]]:
    """Return contacts of one model that may be in the same places, together."""
    groups: dict[object, list[int]] = {}
    for i, (contact, places_of) in enumerate(zip(problem.models, own, strict=True)):
        groups.setdefault((contact, places_of.faces, places_of.key), []).append(i)
    return list(groups.values())

"""Scope of the bound: the relaxed problem that the bound covers, and the problem parts that it drops."""

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
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.pad import PAD_SHAPES
from nlpgrasp.errors import NotCoveredError
from nlpgrasp.global_bound.allowed_regions import AllowedRegion, allowed_regions
from nlpgrasp.global_bound.cell_supports import CombinationRule, Supports
from nlpgrasp.global_bound.cells.cell import CellFace
from nlpgrasp.global_bound.cells.cell_faces import cell_faces
from nlpgrasp.global_bound.contact_cells import BundleLevel, ContactCells, ContactClusters, RootCells
from nlpgrasp.global_bound.symmetry import RotatedRoots, Symmetry, restrict_by_rotation, symmetries
from nlpgrasp.problem.problem import GraspProblem

MOST_ROOTS = 300  # largest number of root nodes; beyond it root cells are united


@dataclass(frozen=True)
class BoundScope:
    """Relaxed problem of the bound, with each contact anywhere in its own allowed region.

    Parameters
    ----------
    problem : GraspProblem
    rule : CombinationRule
    contact_cells : tuple of ContactCells
        One for each group of identical contacts.
    symmetries : tuple of Symmetry
        Without the identity.
    dropped : tuple of str
        Names of the dropped parts, which can only lower mu.
    """

    problem: GraspProblem
    rule: CombinationRule
    contact_cells: tuple[ContactCells, ...]
    symmetries: tuple[Symmetry, ...]
    dropped: tuple[str, ...]

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres, body frame."""
        return self.problem.origin

    @cached_property
    def groups(self) -> tuple[tuple[ContactCells, slice], ...]:
        """Groups of identical contacts: the cells of each group, and the range of its contacts in a node."""
        ends = np.cumsum([0] + [len(group.contact_indices) for group in self.contact_cells]).tolist()
        return tuple((group, slice(*limits)) for group, limits in zip(self.contact_cells, pairwise(ends), strict=True))

    @cached_property
    def group_of(self) -> tuple[tuple[ContactCells, slice], ...]:
        """The group of each contact, in the order of contacts in a node."""
        return tuple(group for group in self.groups for _ in group[0].contact_indices)

    @property
    def contact_of_slot(self) -> tuple[int, ...]:
        """The problem's index of each contact, in the order of contacts in a node."""
        return tuple(contact for group in self.contact_cells for contact in group.contact_indices)


def scope_of(problem: GraspProblem) -> BoundScope:
    """Return the relaxed problem that the bound covers, with a limited number of root nodes.

    There is a root node for each choice of root cells. Where these are too many, the root cells of a face, or of all
    faces, are united.

    Raises
    ------
    NotCoveredError
        On a body, a contact model, a force budget or an objective that the bound does not cover, or constraints that
        leave a contact no place.
    """
    rule, faces, contacts = _check_coverage(problem)
    regions, dropped = _relax(problem, contacts)
    rotated = restrict_by_rotation(problem, faces, regions)
    for level in BundleLevel:
        cells = _create_cells(problem, faces, contacts, regions, rule, level, rotated)
        group = symmetries(problem.body, problem.task, problem.origin, cells)
        choices = prod(comb(len(c.roots) + len(c.contact_indices) - 1, len(c.contact_indices)) for c in cells)
        if choices <= MOST_ROOTS * (1 + len(group)):
            break
    return BoundScope(problem, rule, tuple(cells), tuple(group), dropped)


def whole_scope(problem: GraspProblem) -> BoundScope:
    """Return the relaxed problem with one root cell per contact, without symmetries.

    Raises
    ------
    NotCoveredError
        As ``scope_of``.
    """
    rule, faces, contacts = _check_coverage(problem)
    regions, dropped = _relax(problem, contacts)
    cells = _create_cells(problem, faces, contacts, regions, rule, BundleLevel.ALL, [])
    return BoundScope(problem, rule, tuple(cells), (), dropped)


def _relax(problem: GraspProblem, contacts: Sequence[ContactModel]) -> tuple[list[AllowedRegion], tuple[str, ...]]:
    """Return the allowed region of each contact, and the names of all dropped parts, edge margin and pads included.

    These are also the edge margin of a mesh, and what relaxed contacts ignore.
    """
    regions, dropped, _ = allowed_regions(problem)
    has_margin = (isinstance(problem.body, Mesh) or problem.body.charts()) and problem.margin > 0.0
    is_relaxed = any(contact is not model for contact, model in zip(contacts, problem.models, strict=True))
    return regions, (*dropped, *([EDGES] if has_margin else []), *([PAD_SHAPES] if is_relaxed else []))


def _check_coverage(problem: GraspProblem) -> tuple[CombinationRule, Sequence[CellFace], list[ContactModel]]:
    """Return the combination rule, the body's faces and the relaxed contacts; raise for a problem not covered."""
    if problem.objective == "nu":
        raise NotCoveredError("GraspProblem.objective", "nu", "mu or delta for a bound over all placements")
    rule, faces = CombinationRule.of(problem.budget), cell_faces(problem.body, problem.margin)
    if faces is None:
        raise NotCoveredError(
            "best_possible.body", problem.body.kind, "a body of flat faces, a round one, a mesh, or one with charts"
        )
    contacts = list[ContactModel]()
    for i, model in enumerate(problem.models):
        contact = model.isotropic_relaxation(problem.body.space)
        if contact is None:
            allowed = "point, friction, soft, line or plane contacts for a global bound"
            raise NotCoveredError(f"contacts[{i}]", model.kind, allowed)
        contacts.append(contact)
    return rule, faces, contacts


def _create_cells(
    problem: GraspProblem,
    faces: Sequence[CellFace],
    contacts: Sequence[ContactModel],
    regions: Sequence[AllowedRegion],
    rule: CombinationRule,
    level: BundleLevel,
    rotated: Sequence[RotatedRoots],
) -> list[ContactCells]:
    """Return the cells of each group of identical contacts.

    A contact that is restricted by rotation is a group by itself.
    """
    groups, create = list[ContactCells](), ContactClusters if isinstance(problem.body, Mesh) else ContactCells
    for identical in identical_contacts(contacts, regions):
        region = regions[identical[0]]
        roots = [([i], RootCells(rotated[i][1], rotated[i][0])) for i in identical if i < len(rotated)]
        free = [i for i in identical if i >= len(rotated)]
        if free:
            clipped = [region.allowed.clip_face(face) for face in faces if face.name in region.faces]
            roots.append((free, RootCells({face: face.cells() for face in clipped if face is not None}, None, level)))
        for indices, root_cells in roots:
            supports = Supports(contacts[indices[0]], rule, problem.origin)
            groups.append(create(indices, root_cells, region.allowed, supports, problem.body.size))
            if not groups[-1].roots:
                allowed = "constraints that leave every contact some part of the body"
                raise NotCoveredError("GraspProblem.constraints", f"no place left for contact {indices[0]}", allowed)
    return groups


def identical_contacts(contacts: Sequence[ContactModel], regions: Sequence[AllowedRegion]) -> list[list[int]]:
    """Return the indices of contacts, grouped by contact model and region."""
    groups: dict[object, list[int]] = {}
    for i, (contact, region) in enumerate(zip(contacts, regions, strict=True)):
        groups.setdefault((contact, region.faces, region.key), []).append(i)
    return list(groups.values())

"""Checks of a global bound's certificate: coverage, symmetries and the resulting bound on mu."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.tasks import Task, task_from_dict
from nlpgrasp.verify.bound.face_cover import FACE_MAKERS, TOLERANCE, Faces, faces_of, uncovered_faces
from nlpgrasp.verify.bound.leaves import StatedBudget, StatedContact, StatedLeaves
from nlpgrasp.verify.bound.node_cover import StatedGroup, StatedNodes
from nlpgrasp.verify.bound.stated_cells import StatedMeshCell
from nlpgrasp.verify.bound.stated_regions import StatedRegion, allowed_regions
from nlpgrasp.verify.bound.stated_symmetry import RotationTest, error_of_motion, error_of_reduction
from nlpgrasp.verify.check import BROKEN, Check, NotCheckedError, broken_data_message
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import NumericBody
from nlpgrasp.verify.surface_geometry import TriangleSurface

SUPPORT_TOLERANCE = 1e-9  # relative tolerance of the task's unit support along a direction
BOUND_TOLERANCE = 1e-10  # share of the largest bound that a stated bound may lack of the recomputed one


class Proof:
    """Problem and certificate of a global upper bound on mu, with the checks of the certificate.

    Parameters
    ----------
    problem : mapping
        Problem as in a solution file.
    data : mapping
        The certificate.
    sources : SourceFolders
    """

    def __init__(self, problem: Json, data: Json, sources: SourceFolders) -> None:
        self.problem, self.data, self.sources = problem, data, sources

    @cached_property
    def task(self) -> Task:
        """Task of the problem, about the torque origin."""
        return task_from_dict(self.problem["task"]).about(self.origin)

    @cached_property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres."""
        return array("origin", self.data["origin"], (None,))

    @cached_property
    def surface(self) -> NumericBody:
        """Numeric model of the body."""
        return BODIES.of(self.problem["body"])(self.problem["body"], self.sources)

    @cached_property
    def size(self) -> float:
        """Half the diagonal of the body's bounding box, metres."""
        return 0.5 * float(np.linalg.norm(self.surface.bounds[1] - self.surface.bounds[0]))

    @cached_property
    def faces(self) -> Faces:
        """Faces of the body by name, each reduced by the edge margin along its sharp edges."""
        margin = number("edge_margin", self.problem.get("edge_margin", 0.0), at_least=0.0)
        return faces_of(self.problem["body"], margin)

    @cached_property
    def _regions_and_dropped_parts(self) -> tuple[list[StatedRegion], list[str]]:
        """Allowed region of each contact, and the parts of the problem that the bound ignores."""
        whole = self.problem["body"]["type"] not in FACE_MAKERS
        return allowed_regions(self.problem, tuple(self.faces), len(self.origin), self.sources, whole)

    @property
    def regions(self) -> list[StatedRegion]:
        """Allowed region of each contact."""
        return self._regions_and_dropped_parts[0]

    @property
    def dropped_parts(self) -> list[str]:
        """Parts of the problem that the bound ignores, as text."""
        return self._regions_and_dropped_parts[1]

    @cached_property
    def groups(self) -> list[StatedGroup]:
        """Groups of interchangeable contacts, with their cells."""
        return [StatedGroup(group, self._triangles) for group in self.data["groups"]]

    def _triangles(self) -> TriangleSurface:
        """Return the triangles of the mesh body; raise ``ValueError`` for any other body."""
        if not isinstance(self.surface, MeshSurface):
            raise ValueError(f"cells of a mesh on a {self.problem['body']['type']}")
        return self.surface.triangles

    @cached_property
    def nodes(self) -> StatedNodes:
        """Nodes of the search tree, each with one surface cell per contact."""
        return StatedNodes(self.data, self.groups, self.size)

    def checks(self, upper: float, dropped: Sequence[str]) -> list[Check]:
        """Return the checks that an upper bound on mu follows from the certificate.

        Parameters
        ----------
        upper : float
            The claimed bound.
        dropped : sequence of str
            The stated dropped parts of the problem.
        """
        parts: dict[str, Callable[[], tuple[str, str]]] = {
            "dropped": partial(self._check_dropped, dropped),
            "alike": self._check_alike,
            "faces covered": self._check_covered,
            "turned": self._check_turned,
            "cuts": self._check_cuts,
            "nodes": self._check_nodes,
            "symmetries": self._check_symmetries,
            "directions": self._check_directions,
            "leaves": self._check_leaves,
            "upper": partial(self._check_upper, upper),
        }
        return [_check_part(name, part) for name, part in parts.items()]

    def _check_dropped(self, stated: Sequence[str]) -> tuple[str, str]:
        """Check the stored list of ignored parts of the problem; return an error text and a summary."""
        dropped = self.dropped_parts
        error = "" if list(stated) == dropped else f"stated {list(stated)}, the problem leaves out {dropped}"
        return error, ", ".join(dropped) if dropped else "nothing left out"

    def _check_alike(self) -> tuple[str, str]:
        """Check that the contacts of each group are interchangeable; return an error text and a summary."""
        regions, contacts = self.regions, self.problem["contacts"]
        models = [StatedContact.of(contact, self.budget) for contact in contacts]
        contact_indices = [i for group in self.groups for i in group.contacts]
        if sorted(contact_indices) != list(range(len(contacts))):
            return f"cells for the contacts {contact_indices}, of {len(contacts)}", ""
        for contact, *others in (group.contacts for group in self.groups):
            for other in others:
                if models[contact] != models[other] or not regions[contact].equals(regions[other]):
                    return f"contacts {contact} and {other} are not alike", ""
        return "", f"{len(contacts)} contacts in {len(self.groups)} groups"

    def _check_covered(self) -> tuple[str, str]:
        """Check that the root cells cover the allowed faces; return an error text and a summary.

        Cells of a contact that rotation restricts to a part of its face are left to ``_check_turned``.
        """
        for data, group in zip(self.data["groups"], self.groups, strict=True):
            region = self.regions[group.contacts[0]]
            cells = [cell for _, cell in data["roots"]]
            uncovered = [] if data["turned"] is not None else uncovered_faces(self.faces, region, cells, self.size)
            mesh_cells = [cell for number in group.roots if isinstance(cell := group.cells[number], StatedMeshCell)]
            if any(self.faces[name] is None for name in region.faces):
                missing = min((cell.count_missing(self._triangles()) for cell in mesh_cells), default=None)
                if missing is None or missing > 0:
                    return f"contact {group.contacts[0]} may also be on {missing} other pieces of the mesh", ""
            if uncovered:
                return f"contact {group.contacts[0]} may also be elsewhere on {', '.join(uncovered)}", ""
        return "", f"{sum(len(group.roots) for group in self.groups)} cells to begin with"

    def _check_turned(self) -> tuple[str, str]:
        """Check that symmetry allows contacts to be restricted to a line or a pole; return an error text and a summary.

        The line is that of a half-plane through the axis, or a meridian.
        """
        rotation_test = RotationTest(self.problem["body"], self.task, self.origin, self.size)
        reductions = [str(group["turned"]) for group in self.data["groups"] if group["turned"] is not None]
        error = error_of_reduction(self.data["groups"], rotation_test, self.faces, self.regions)
        return error, ", ".join(reductions) if reductions else "no contact is turned to a line"

    def _check_cuts(self) -> tuple[str, str]:
        """Check that constraints exclude the omitted parts of cells; return an error text and a summary."""
        for group in self.groups:
            omitted = group.wrongly_omitted(self.regions[group.contacts[0]], TOLERANCE * self.size)
            if omitted:
                return f"a part of cell {omitted[0]} is left out, though constraints allow it", ""
        return "", f"{sum(len(group.parts) for group in self.groups)} cells cut"

    def _check_nodes(self) -> tuple[str, str]:
        """Check that the nodes cover all placements; return an error text and a summary."""
        nodes = self.nodes
        counts = f"{len(nodes.splits)} cut, {len(nodes.copies)} twins, {len(nodes.leaves)} leaves"
        return nodes.uncovered(), counts

    def _check_symmetries(self) -> tuple[str, str]:
        """Check that motions are symmetries and map nodes onto their copies; return an error text and a summary."""
        for i, motion in enumerate(self.data["motions"]):
            error = error_of_motion(motion, self.problem, self.task, self.origin, self.regions, self.size)
            if error:
                return f"motion {i}: {error}", ""
        wrong_nodes = self.nodes.wrong_symmetric_copies()
        error = f"node {list(wrong_nodes[0])} is not mapped onto its twin" if wrong_nodes else ""
        return error, f"{len(self.data['motions'])} motions, {len(self.nodes.copies)} twins"

    @cached_property
    def budget(self) -> StatedBudget:
        """Force budget of the problem, as the leaf bounds use it."""
        return StatedBudget.of(self.problem["force_budget"])

    @cached_property
    def leaves(self) -> StatedLeaves:
        """Leaf nodes of the search tree, with the data of their bounds."""
        return StatedLeaves(self.data, self.groups, self.problem["contacts"], self.task, self.budget)

    def _check_directions(self) -> tuple[str, str]:
        """Check that the task's support along each direction is 1; return an error text and a summary."""
        deviation = float(np.max(np.abs(self.leaves.supports - 1.0), initial=0.0))
        summary = f"the task's work along {len(self.leaves.supports)} directions is 1 to {deviation:.2g}"
        return "" if deviation <= SUPPORT_TOLERANCE else summary, summary

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Claimed and recomputed upper bounds of the leaves, (n,) each.

        Claims below half of the largest one are raised to it.
        """
        return self.leaves.bounds()

    def _check_leaves(self) -> tuple[str, str]:
        """Check that no recomputed leaf bound exceeds the claimed one; return an error text and a summary."""
        claimed, recomputed = self.bounds
        excess = (recomputed - claimed) / float(np.max(recomputed, initial=1e-300))
        worst = int(np.argmax(excess)) if len(excess) else 0
        if not np.all(excess <= BOUND_TOLERANCE):
            return f"leaf {worst} states {claimed[worst]:.12g}, computed again {recomputed[worst]:.12g}", ""
        return "", f"{len(recomputed)} bounds computed again, none above what is stated"

    def _check_upper(self, upper: float) -> tuple[str, str]:
        """Check that the upper bound is not below the largest leaf bound; return an error text and a summary."""
        largest = float(np.max(self.bounds[1], initial=0.0))
        summary = f"stated {upper:.12g}, from the leaves {largest:.12g}"
        return "" if upper >= largest * (1.0 - BOUND_TOLERANCE) else summary, summary


def _check_part(name: str, part: Callable[[], tuple[str, str]]) -> Check:
    """Return the check of one part of a certificate.

    ``part`` returns an error text, empty if the part is correct, and a summary.
    """
    try:
        error_text, summary = part()
    except NotCheckedError as reason:
        return Check.not_made(name, str(reason))
    except BROKEN as error:
        return Check(name, False, broken_data_message(error))
    return Check.of_errors(name, [error_text], summary)

"""Checks of a bound's certificate: coverage, symmetries and the resulting bound on mu."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.tasks import Task, task_from_dict
from nlpgrasp.verify.bound.face_cover import SAME, Faces, faces_of, uncovered_faces
from nlpgrasp.verify.bound.leaves import Budget, Leaves
from nlpgrasp.verify.bound.node_cover import Group, StatedNodes
from nlpgrasp.verify.bound.stated_cells import StatedMeshCell
from nlpgrasp.verify.bound.stated_regions import StatedRegion, places
from nlpgrasp.verify.bound.stated_symmetry import RotationTest, error_of_motion, error_of_reduction
from nlpgrasp.verify.check import BROKEN, Check, NotCheckedError, broken_data_message
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import NumericBody
from nlpgrasp.verify.surface_geometry import TriangleSurface

UNIT = 1e-9  # relative tolerance of the task's unit support along a direction
RECOMPUTED = 1e-10  # share of the largest bound that a stated bound may lack of the recomputed one


class Proof:
    """A problem with the certificate of a global upper bound on mu.

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
        """Task about the torque origin."""
        return task_from_dict(self.problem["task"])

    @cached_property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres."""
        return array("origin", self.data["origin"], (2 if self.task.dimension == 3 else 3,))

    @cached_property
    def surface(self) -> NumericBody:
        """The numeric body."""
        return BODIES.of(self.problem["body"])(self.problem["body"], self.sources)

    @cached_property
    def size(self) -> float:
        """Half the diagonal of the body's bounding box, metres."""
        return 0.5 * float(np.linalg.norm(self.surface.bounds[1] - self.surface.bounds[0]))

    @cached_property
    def faces(self) -> Faces:
        """The body's faces."""
        margin = number("edge_margin", self.problem.get("edge_margin", 0.0), at_least=0.0)
        return faces_of(self.problem["body"], margin)

    @cached_property
    def asked(self) -> tuple[list[StatedRegion], list[str]]:
        """Allowed region of each contact, and the relaxed parts of the problem."""
        return places(self.problem, tuple(self.faces), len(self.origin), self.sources)

    @cached_property
    def groups(self) -> list[Group]:
        """Groups of interchangeable contacts, with their cells."""
        return [Group(group, self._triangles) for group in self.data["groups"]]

    def _triangles(self) -> TriangleSurface:
        if not isinstance(self.surface, MeshSurface):
            raise ValueError(f"cells of a mesh on a {self.problem['body']['type']}")
        return self.surface.triangles

    @cached_property
    def nodes(self) -> StatedNodes:
        """The nodes of the search tree: a cell for each contact."""
        return StatedNodes(self.data, self.groups, self.size)

    def checks(self, upper: float, dropped: Sequence[str]) -> list[Check]:
        """Return the checks that a bound follows from the certificate.

        Parameters
        ----------
        upper : float
            The claimed bound.
        dropped : sequence of str
            The stated relaxed parts of the problem.
        """
        parts: dict[str, Callable[[], tuple[str, str]]] = {
            "dropped": partial(self._dropped, dropped),
            "alike": self._alike,
            "faces covered": self._covered,
            "turned": self._turned,
            "cuts": self._cuts,
            "nodes": self._nodes,
            "symmetries": self._symmetries,
            "directions": self._directions,
            "leaves": self._leaves,
            "upper": partial(self._upper, upper),
        }
        return [_check_part(name, part) for name, part in parts.items()]

    def _dropped(self, stated: Sequence[str]) -> tuple[str, str]:
        found = self.asked[1]
        wrong = "" if list(stated) == found else f"stated {list(stated)}, the problem leaves out {found}"
        return wrong, ", ".join(found) if found else "nothing left out"

    def _alike(self) -> tuple[str, str]:
        own, contacts = self.asked[0], self.problem["contacts"]
        numbers = [i for group in self.groups for i in group.contacts]
        if sorted(numbers) != list(range(len(contacts))):
            return f"cells for the contacts {numbers}, of {len(contacts)}", ""
        for first, *rest in (group.contacts for group in self.groups):
            for other in rest:
                if contacts[first] != contacts[other] or not own[first].same(own[other]):
                    return f"contacts {first} and {other} are not alike", ""
        return "", f"{len(contacts)} contacts in {len(self.groups)} groups"

    def _covered(self) -> tuple[str, str]:
        for data, group in zip(self.data["groups"], self.groups, strict=True):
            own = self.asked[0][group.contacts[0]]
            cells = [cell for _, cell in data["roots"]]
            left = [] if data["turned"] is not None else uncovered_faces(self.faces, own, cells, self.size)
            meshes = [cell for number in group.roots if isinstance(cell := group.cells[number], StatedMeshCell)]
            if any(self.faces[name] is None for name in own.faces):
                missing = min((cell.left_out(self._triangles()) for cell in meshes), default=None)
                if missing is None or missing > 0:
                    return f"contact {group.contacts[0]} may also be on {missing} other pieces of the mesh", ""
            if left:
                return f"contact {group.contacts[0]} may also be elsewhere on {', '.join(left)}", ""
        return "", f"{sum(len(group.roots) for group in self.groups)} cells to begin with"

    def _turned(self) -> tuple[str, str]:
        turning = RotationTest(self.problem["body"], self.task, self.origin, self.size)
        ways = [str(group["turned"]) for group in self.data["groups"] if group["turned"] is not None]
        wrong = error_of_reduction(self.data["groups"], turning, self.faces, self.asked[0])
        return wrong, ", ".join(ways) if ways else "no contact is turned to a line"

    def _cuts(self) -> tuple[str, str]:
        for group in self.groups:
            wrong = group.wrongly_omitted(self.asked[0][group.contacts[0]], SAME * self.size)
            if wrong:
                return f"a part of cell {wrong[0]} is left out, though constraints allow it", ""
        return "", f"{sum(len(group.parts) for group in self.groups)} cells cut"

    def _nodes(self) -> tuple[str, str]:
        nodes = self.nodes
        counts = f"{len(nodes.splits)} cut, {len(nodes.twins)} twins, {len(nodes.leaves)} leaves"
        return nodes.uncovered(), counts

    def _symmetries(self) -> tuple[str, str]:
        for i, motion in enumerate(self.data["motions"]):
            wrong = error_of_motion(motion, self.problem, self.task, self.origin, self.asked[0], self.size)
            if wrong:
                return f"motion {i}: {wrong}", ""
        false = self.nodes.wrong_symmetric_copies()
        wrong = f"node {list(false[0])} is not mapped onto its twin" if false else ""
        return wrong, f"{len(self.data['motions'])} motions, {len(self.nodes.twins)} twins"

    @cached_property
    def leaves(self) -> Leaves:
        """The leaves, with the data of their bounds."""
        budget = Budget.of(self.problem["force_budget"])
        return Leaves(convert_older(self.data), self.groups, self.problem["contacts"], self.task, budget)

    def _directions(self) -> tuple[str, str]:
        off = float(np.max(np.abs(self.leaves.reach - 1.0), initial=0.0))
        detail = f"the task's work along {len(self.leaves.reach)} directions is 1 to {off:.2g}"
        return "" if off <= UNIT else detail, detail

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The leaves' stated and recomputed bounds."""
        return self.leaves.bounds()

    def _leaves(self) -> tuple[str, str]:
        stated, found = self.bounds
        off = (found - stated) / float(np.max(found, initial=1e-300))
        worst = int(np.argmax(off)) if len(off) else 0
        if not np.all(off <= RECOMPUTED):
            return f"leaf {worst} states {stated[worst]:.12g}, computed again {found[worst]:.12g}", ""
        return "", f"{len(found)} bounds computed again, none above what is stated"

    def _upper(self, upper: float) -> tuple[str, str]:
        most = float(np.max(self.bounds[1], initial=0.0))
        detail = f"stated {upper:.12g}, from the leaves {most:.12g}"
        return "" if upper >= most * (1.0 - RECOMPUTED) else detail, detail


def convert_older(data: Json) -> Json:
    """Return a certificate whose leaves refer to dual weights by number, converted from older files."""
    if "mixtures" in data:
        return data
    mixtures = [[numbers, weights] for _, numbers, weights, _ in data["leaves"]]
    leaves = [[cells, i, bound] for i, (cells, _, _, bound) in enumerate(data["leaves"])]
    return {**data, "mixtures": mixtures, "leaves": leaves}


def _check_part(name: str, part: Callable[[], tuple[str, str]]) -> Check:
    """Return the check of a part, whose function returns what is wrong, if anything, and what was seen."""
    try:
        wrong, seen = part()
    except NotCheckedError as reason:
        return Check.not_made(name, str(reason))
    except BROKEN as error:
        return Check(name, False, broken_data_message(error))
    return Check(name, not wrong, wrong or seen)

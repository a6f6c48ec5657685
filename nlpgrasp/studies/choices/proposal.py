"""Records of a rule-based choice: proposals with their reasons, before any solve."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.bodies import Body
from nlpgrasp.common.types import Json
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task


@dataclass(frozen=True)
class Reason:
    """Rule and source of one proposal.

    Parameters
    ----------
    what : str
        The proposal, with its value.
    rule : str
        The rule, with its numbers.
    source : str
        Reference.
    """

    what: str
    rule: str
    source: str

    def __str__(self) -> str:
        return f"{self.what}: {self.rule} ({self.source})"


@dataclass(frozen=True)
class FirstChoice:
    """Rule-based initial choice of a grasp; nothing is solved or certified.

    Parameters
    ----------
    body : Body
        The held body.
    mass : float
        Kilograms.
    grasp_type : {"precision", "power"}
        Fingertips alone, or links and palm as well.
    name : str
        The grasp's name in Cutkosky's taxonomy.
    contact : ContactModel
        Contact model of every contact.
    count : int
        Number of contacts.
    normal_force : float
        Required normal force of each contact, newtons, with the safety factor, if all contacts are on vertical walls
        and share the load evenly.
    opening : float
        Gripper opening, metres: the body's shortest side plus clearance on both sides.
    safety : float
        Factor on the forces that the weight requires.
    task : Task
        The weight, accelerations and a disturbance, about ``torque_origin``.
    torque_origin : (3,) tuple
        The centre of mass, metres, body frame.
    reasons : tuple of Reason
        Rule and source of each number.
    """

    body: Body
    mass: float
    grasp_type: str
    name: str
    contact: ContactModel
    count: int
    normal_force: float
    opening: float
    safety: float
    task: Task
    torque_origin: tuple[float, float, float]
    reasons: tuple[Reason, ...]

    @property
    def hand(self) -> Hand | None:
        """A gripper for two contacts; None, for free fingertips, with more."""
        return ParallelJaw(self.opening) if self.count == 2 else None

    def problem(self) -> GraspProblem:
        """Return the problem to solve: each normal force at most 1 N, so that ``needed_force`` is in newtons."""
        return GraspProblem(
            self.body,
            [self.contact] * self.count,
            self.task,
            hand=self.hand,
            force_budget="per_finger",
            torque_origin=self.torque_origin,
            name=f"first choice: {self.name}",
        )

    def needed_force(self, solution: GraspSolution) -> float:
        """Return the certified normal force of each contact for the whole task, times the safety factor, newtons.

        Raises
        ------
        InputError
            Where the solution has no grasp that exerts the task, or another budget than normal forces.
        """
        if not isinstance(solution, GraspSolution) or not solution.success:
            raise InputError("solution", solution, "a solution with a grasp that exerts the task's wrenches")
        if solution.budget.kind != "per_finger":
            raise InputError("solution", f"force budget {solution.budget.kind!r}", "'per_finger', as problem() has")
        return self.safety / solution.mu.lower

    def to_dict(self) -> Json:
        """Return the choice as JSON data."""
        return {
            "mass": self.mass,
            "grasp_type": self.grasp_type,
            "name": self.name,
            "contact": self.contact.to_dict(),
            "count": self.count,
            "normal_force": self.normal_force,
            "opening": self.opening,
            "safety": self.safety,
            "task": self.task.to_dict(),
            "reasons": [{"what": r.what, "rule": r.rule, "source": r.source} for r in self.reasons],
        }

    def __str__(self) -> str:
        lines = [f"{self.count} {self.contact.label} contacts, {self.grasp_type} grasp: {self.name}"]
        return "\n".join([*lines, *(f"  {reason}" for reason in self.reasons)])

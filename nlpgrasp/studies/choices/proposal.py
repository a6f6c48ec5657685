"""What is proposed for a body before anything is solved."""

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
    """Why something is proposed.

    Parameters
    ----------
    what : str
        What is proposed, with its value.
    rule : str
        The rule, with its numbers.
    source : str
        Where it is from.
    """

    what: str
    rule: str
    source: str

    def __str__(self) -> str:
        return f"{self.what}: {self.rule} ({self.source})"


@dataclass(frozen=True)
class FirstChoice:
    """A first choice of grasp, from rules alone: nothing is solved or certified.

    Parameters
    ----------
    body : Body
        What is held.
    mass : float
        Kilograms.
    grasp_type : {"precision", "power"}
        Fingertips alone, or links and palm as well.
    name : str
        The grasp's name in Cutkosky's taxonomy.
    contact : ContactModel
        Of every contact.
    count : int
        Number of contacts.
    normal_force : float
        That each contact has to press with, newtons, with the safety factor, where all contacts are on upright walls
        and share the load evenly.
    opening : float
        Of a gripper, metres: the body's width across its shortest side and room on both sides of it.
    safety : float
        Factor on the forces that the weight asks for.
    task : Task
        The weight, accelerations and a disturbance, about ``torque_origin``.
    torque_origin : (3,) tuple
        The centre of mass, metres, body frame.
    reasons : tuple of Reason
        Why each number is what it is, with its source.
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
        """A gripper for two contacts; None, free fingertips, for more."""
        return ParallelJaw(self.opening) if self.count == 2 else None

    def problem(self) -> GraspProblem:
        """Return the problem, ready to solve: each normal force at most 1 N, so that ``needed_force`` is in newtons."""
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
        """Return the normal force of each contact for the whole task, certified, times the safety factor, newtons.

        Raises
        ------
        InputError
            Where the solution is not of a grasp that exerts the task, with normal forces as its budget.
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

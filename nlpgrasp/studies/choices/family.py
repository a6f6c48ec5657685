"""Problems that differ in their contacts, solved with each other's grasps.

A grasp found with fewer or poorer contacts is one of every larger problem, and never a worse one: with forces x of its
own contacts and none of the others, ``G' x' = G x``. So ``G (B n K)`` is inside ``G' (B' n K')`` wherever the larger
budget allows the forces that the smaller one allows, the other components being zero. That is so of the L2 norm of all
forces, of bounds on each normal force or on each force, of their sum, and of joint torques in the same posture; then mu
of the larger grasp is at least that of the smaller, and every certified lower bound carries over. Downwards a grasp of
the larger problem is a start for the smaller one, without any such promise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.registry import body_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.ongoing import Ongoing
from nlpgrasp.solve.start.given import Given
from nlpgrasp.solve.start.result import StartGrasp

CARRIES = ("l2", "per_finger", "per_finger_size", "shared", "hand_torques")  # budgets of which the promise holds
HOPEFUL = 0.5  # of the larger problem's best: a smaller one's grasp is improved there from this share
SWEEPS = 3  # down and up again, at most


class Step(Protocol):
    """How grasps go from a problem to another one."""

    def up(self, found: StartGrasp, small: Ongoing, large: Ongoing) -> Given | None:
        """Return a grasp of the smaller problem as one of the larger, with what it promises; None where it is none."""

    def down(self, found: StartGrasp, large: Ongoing, small: Ongoing) -> Given | None:
        """Return a grasp of the larger problem as a start for the smaller; None where there is none."""


@dataclass(frozen=True)
class Family:
    """Solves that help each other.

    Parameters
    ----------
    solves : sequence of Ongoing
        The smaller before the larger.
    pairs : sequence of (int, int)
        Places of a smaller and of a larger one.
    step : Step
    scouts : int
        How many of the best of many random placements each begins from as well.
    """

    solves: Sequence[Ongoing]
    pairs: Sequence[tuple[int, int]]
    step: Step
    scouts: int = 2

    def run(self) -> None:
        """Run all starts, then carry grasps up and down until no best grasp changes."""
        told: set[tuple[int, int, int]] = set()
        for solve in self.solves:
            solve.run_starts()
            solve.scout(self.scouts)
        self._up(told)
        for _ in range(SWEEPS):
            if not self._down(told):
                break
            self._up(told)
        self._keep_promises()

    def _up(self, told: set[tuple[int, int, int]]) -> None:
        for a, b in sorted(self.pairs, key=lambda pair: (pair[1], pair[0])):
            small, large = self.solves[a], self.solves[b]
            best = small.best
            if best is None or (a, b, best.record.index) in told:
                continue
            told.add((a, b, best.record.index))
            given = self.step.up(best, small, large)
            own = large.best
            hopeful = own is None or best.record.mu.upper >= HOPEFUL * own.record.mu.lower
            if given is not None:
                large.offer(given, hopeful)

    def _keep_promises(self) -> None:
        """Certify the best grasps as tightly as the answers, and hand on what these certificates promise."""
        for j, large in enumerate(self.solves):
            for small in (self.solves[a] for a, b in self.pairs if b == j):
                best, own = small.best, large.best
                given = None if best is None else self.step.up(best, small, large)
                if given is not None and given.floor > (0.0 if own is None else own.record.mu.lower):
                    large.offer(given, improve=False)
            large.sharpen()

    def _down(self, told: set[tuple[int, int, int]]) -> bool:
        """Offer the larger problems' grasps to the smaller; return whether any of these has a better one now."""
        rose = False
        for a, b in sorted(self.pairs, key=lambda pair: (-pair[0], -pair[1])):
            small, large = self.solves[a], self.solves[b]
            best = large.best
            if best is None or (b, a, best.record.index) in told:
                continue
            told.add((b, a, best.record.index))
            given = self.step.down(best, large, small)
            rose |= given is not None and small.offer(given)
        return rose


def promised(found: StartGrasp, small: GraspProblem, large: GraspProblem) -> float:
    """Return what a grasp of the smaller problem promises in the larger: its certified bound, 0 where nothing.

    Parameters
    ----------
    found : StartGrasp
    small, large : GraspProblem
        Of the same body.
    """
    same = small.budget == large.budget and small.budget.kind in CARRIES
    same = same and small.task.to_dict() == large.task.to_dict() and bool((small.origin == large.origin).all())
    return found.record.mu.lower if same else 0.0


def same_body(one: Body, other: Body) -> bool:
    """Return whether two bodies are known to be the same: one object, or with the same data, where these say all."""
    if one is other:
        return True
    data = one.to_dict()
    try:
        body_from_dict(data)
    except InputError:
        return False
    return data == other.to_dict()


def scouts_of(starts: int) -> int:
    """Return how many screened placements to begin from beside so many starts."""
    return max(2, -(-starts // 2))

"""How good the grasp of a solution is: by itself, and against the best that any placement allows."""

from __future__ import annotations

import math

from nlpgrasp.common.shown.numbers import at_most
from nlpgrasp.common.shown.words import measure_word
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.findings import Robustness, WhyNot
from nlpgrasp.solution.joint_room import mu_without, room_lines
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.measures.by_hand import ByHand
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.measures.quality import Quality, held_words
from nlpgrasp.solution.obstructions import of_the_grasp, of_the_way, unknown_links
from nlpgrasp.solution.placed import PlacedGrasp, SurfaceMatch
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.schema.types import SolverData
from nlpgrasp.solution.starts import ipopt_lines, passed_over, starts_lines, winner_of


class Measured(ByHand):
    """The measures of a grasp, for what is asked."""

    name: str
    status: Status
    kkt: KKT | None
    grasp: Grasp | None
    mu: Bounds
    kind: str
    delta: Bounds | None
    nu: Volume | None
    robust: Robustness | None
    bound: GlobalBound | None
    needed: ForcesNeeded | None
    faces: tuple[str, ...]
    surface: SurfaceMatch | None
    prices: tuple[ShadowPrice, ...]
    why_not: WhyNot | None
    starts: tuple[StartRecord, ...]
    best_start: int | None
    hand: Json | None
    solver: SolverData

    @property
    def success(self) -> bool:
        """Whether a grasp with a certified quality above zero was found, and no link of its hand is inside anything."""
        return self.is_certified and not self.touches

    @property
    def is_certified(self) -> bool:
        """Whether a grasp with a certified quality above zero was found, whether its hand can take it or not."""
        return self.grasp is not None and self.mu.lower > 0.0

    @property
    def label(self) -> str:
        """The measure that ``mu`` holds, in words: ``"mu"`` or ``"mu-tilde"``."""
        return measure_word(self.kind)

    @property
    def beta(self) -> Bounds | None:
        """Mu in the paper's sense, the beta of the largest ``A_beta`` (3.3-4a), for a centred task ellipsoid."""
        return self._measured.beta

    @property
    def best_possible(self) -> float:
        """A certified bound on mu over all placements of the contacts; inf where there is none."""
        return math.inf if self.bound is None else self.bound.upper

    @property
    def gap(self) -> float:
        """``best_possible / mu.lower - 1``: by how much of its own quality the grasp misses the best, at most."""
        return math.inf if self.bound is None else self.bound.gap(self.mu.lower)

    @property
    def is_fragile(self) -> bool:
        """Whether next to nothing of the quality is left when contacts are a little off; false where none is known."""
        return self.robust is not None and self.robust.is_fragile(self.mu)

    @property
    def is_too_weak(self) -> bool:
        """Whether the task as given takes more of a finger than ``max_force``; false where either is not known."""
        return self.needed is not None and self.needed.is_within(self.max_force) is False

    @property
    def message(self) -> str:
        """What the status means; of a grasp that is solved, whether it is a local optimum."""
        if self.status is not Status.SOLVED or self.kkt is None:
            return self.status.value
        return str(self.status.value).replace("a local optimum at best", self.kkt.words)

    @property
    def told(self) -> str:
        """The status in words; where the gap is closed, how close, and what is wrong with the grasp."""
        told = self.message
        if self.status is Status.OPTIMAL:
            told = f"Optimal within {at_most(100.0 * self.gap)}%: {told.removeprefix('Optimal: ')}"
        head, _, rest = told.partition(": ")
        if self.status is Status.TOUCHES:
            return f"{head}: {'; and '.join(self.caveats)}; {rest.partition(', and ')[2]}"
        return f"{head}, but {'; and '.join(self.caveats)}; {rest}" if self.caveats else told

    @property
    def caveats(self) -> list[str]:
        """What a user has to know of the grasp before anything else, in words; mostly nothing."""
        said = [*of_the_grasp(self.hand), *of_the_way(self.hand), *filter(None, [unknown_links(self.hand)])]
        if self.robust is not None and self.is_fragile:
            said.append(self.robust.fragile_words(self.mu, self.label))
        if self.needed is not None and self.max_force is not None and self.is_too_weak:
            said.append(self.needed.too_much_words(self.max_force))
        if self.squeeze is None and self.squeeze_line():
            said.append("the hand cannot squeeze the body")
        if self.beyond_effort:
            said.append(self.beyond_effort)
        return said

    @property
    def title(self) -> str:
        """Name and status in a line."""
        return f"{self.name}: {self.told}"

    def quality_lines(self) -> list[str]:
        """Return the certified quality in words, and how far it is from the best possible."""
        paper = "" if self.task.paper_beta in (None, 1.0) else f", beta of the paper in {self.beta}"
        why = f": {self.mu.limit}" if self.mu.limit else ""
        held = held_words(self.kind, self.budget)
        lines = [f"  {self.label} certified in {self.mu} (gap {self.mu.gap:.1%}{why}){paper}: {held}"]
        if self.bound is not None:
            lines.append(f"  {self.bound.line(self.mu.lower, self.label)}")
        room = [] if self._room is None else room_lines(self._room)
        return [*lines, *(f"  {line}" for line in [*self.needed_lines(), *self.lines_by_hand(), *room])]

    def needed_lines(self) -> list[str]:
        """Return what the fingers press for the task as it was given, in words; nothing where it is not known."""
        return [] if self.needed is None else self.needed.lines(self.budget, self.max_force, self.fingers)

    @property
    def winner(self) -> StartRecord | None:
        """The start whose grasp this is; None without a grasp or starts.

        Files of earlier versions do not say which: then the start with the largest certified upper bound.
        """
        return winner_of(self.starts, self.best_start)

    def starts_lines(self) -> list[str]:
        """Return in words how the starts ended, why one with more mu is not the answer, and where IPOPT did not run."""
        before = 0.0 if self._room is None else mu_without(self._room)
        by_what_is_left = bool(self.solver.get("options", {}).get("maximise_robust"))
        over = passed_over(self.starts, self.winner, before, self.label, by_what_is_left, self.squeeze is not None)
        return [*starts_lines(self.starts), *over, *ipopt_lines(self.solver)]

    def __str__(self) -> str:
        lines = [self.title, f"  {self.task_line()}"]
        if self.grasp is not None:
            lines += [*self.quality_lines(), *PlacedGrasp(self.grasp, self.faces, self.surface).lines(self.fingers)]
        elif self.bound is not None:
            lines.append(f"  {self.bound.line(0.0, self.label)}")
        if self.robust is not None:
            lines.append(f"  {self.robust}")
        if self.delta is not None:
            lines.append(f"  delta certified in {self.delta} (torque scale {self.delta.torque_scale:.4g} m)")
        if self.nu is not None:
            lines.append(f"  nu {self.nu}")
        lines += [f"  {line}" for line in self.starts_lines()]
        lines += [f"  {price.words(self.label)}" for price in self.prices[:3]]
        if self.why_not is not None:
            lines += [f"  {line}" for line in (*self.why_not.reasons, *self.why_not.advice)]
        return "\n".join(lines)

    def require_grasp(self) -> Grasp:
        """Return the grasp that was found.

        Raises
        ------
        InputError
            Where none was found.
        """
        if self.grasp is None:
            ended = "" if self.status is Status.NO_GRASP else f" ({self.status.name.lower().replace('_', ' ')})"
            raise InputError("solution", f"no grasp{ended}", "a solution with a grasp")
        return self.grasp

    @property
    def _room(self) -> Json | None:
        """What the room of the hand's joints is, as ``hand`` states it."""
        return (self.hand or {}).get("room")

    @property
    def _measured(self) -> Bounds:
        scale = self.task.paper_beta if self.kind == "mu" and self.grasp is not None else None
        return self.mu.of_measure(self.kind, scale)

    @property
    def _quality(self) -> Quality:
        return Quality(self._measured, self.kind, self.delta, self.nu, self.robust, self.bound, self.needed)

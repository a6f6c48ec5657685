"""Quality measures of a solution's grasp: certified interval, optimality gap and warnings."""

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
    """Base class with the quality measures of the grasp."""

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
        """Whether there is a grasp of certified quality above zero whose hand's links are free."""
        return self.is_certified and not self.touches

    @property
    def is_certified(self) -> bool:
        """Whether there is a grasp of certified quality above zero, whether its hand's links are free or not."""
        return self.grasp is not None and self.mu.lower > 0.0

    @property
    def label(self) -> str:
        """Name of the measure in ``mu``: ``"mu"`` or ``"mu-tilde"``."""
        return measure_word(self.kind)

    @property
    def beta(self) -> Bounds | None:
        """The paper's mu, the beta of the largest ``A_beta`` (3.3-4a), for a centred task ellipsoid."""
        return self._measured.beta

    @property
    def best_possible(self) -> float:
        """Certified upper bound on mu over all placements of the contacts; inf where there is none."""
        return math.inf if self.bound is None else self.bound.upper

    @property
    def gap(self) -> float:
        """Relative optimality gap ``best_possible / mu.lower - 1``, an upper bound."""
        return math.inf if self.bound is None else self.bound.gap(self.mu.lower)

    @property
    def is_fragile(self) -> bool:
        """Whether less than a fifth of the quality is left under contact displacement; false where unknown."""
        return self.robust is not None and self.robust.is_fragile(self.mu)

    @property
    def is_too_weak(self) -> bool:
        """Whether the task at full size needs more than ``max_force`` at a finger; false where either is unknown."""
        return self.needed is not None and self.needed.is_within(self.max_force) is False

    @property
    def message(self) -> str:
        """Meaning of the status; for a solved grasp, whether it is a local optimum."""
        if self.status is not Status.SOLVED or self.kkt is None:
            return self.status.value
        return str(self.status.value).replace("a local optimum at best", self.kkt.words)

    @property
    def told(self) -> str:
        """Status as text, with a closed gap and warnings about the grasp."""
        told = self.message
        if self.status is Status.OPTIMAL:
            told = f"Optimal within {at_most(100.0 * self.gap)}%: {told.removeprefix('Optimal: ')}"
        head, _, rest = told.partition(": ")
        if self.status is Status.TOUCHES:
            return f"{head}: {'; and '.join(self.caveats)}; {rest.partition(', and ')[2]}"
        return f"{head}, but {'; and '.join(self.caveats)}; {rest}" if self.caveats else told

    @property
    def caveats(self) -> list[str]:
        """Warnings about the grasp, as text; mostly empty."""
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
        """Name and status in one line."""
        return f"{self.name}: {self.told}"

    def quality_lines(self) -> list[str]:
        """Return certified quality, optimality gap, forces and hand results as text lines."""
        paper = "" if self.task.paper_beta in (None, 1.0) else f", beta of the paper in {self.beta}"
        why = f": {self.mu.limit}" if self.mu.limit else ""
        held = held_words(self.kind, self.budget)
        lines = [f"  {self.label} certified in {self.mu} (gap {self.mu.gap:.1%}{why}){paper}: {held}"]
        if self.bound is not None:
            lines.append(f"  {self.bound.line(self.mu.lower, self.label)}")
        room = [] if self._room is None else room_lines(self._room)
        return [*lines, *(f"  {line}" for line in [*self.needed_lines(), *self.lines_by_hand(), *room])]

    def needed_lines(self) -> list[str]:
        """Return the finger forces for the task at full size as text lines; empty where unknown."""
        return [] if self.needed is None else self.needed.lines(self.budget, self.max_force, self.fingers)

    @property
    def winner(self) -> StartRecord | None:
        """The start whose grasp is the answer; None without a grasp or starts.

        In files of earlier versions, which do not state it, the start with the largest certified upper bound.
        """
        return winner_of(self.starts, self.best_start)

    def starts_lines(self) -> list[str]:
        """Return text lines on the ends of the starts, better starts passed over, and failed calls of IPOPT."""
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
        """Return the grasp, or raise ``InputError`` where there is none.

        Raises
        ------
        InputError
            Where the solution has no grasp.
        """
        if self.grasp is None:
            ended = "" if self.status is Status.NO_GRASP else f" ({self.status.name.lower().replace('_', ' ')})"
            raise InputError("solution", f"no grasp{ended}", "a solution with a grasp")
        return self.grasp

    @property
    def _room(self) -> Json | None:
        """Joint-limit margins as ``hand`` states them."""
        return (self.hand or {}).get("room")

    @property
    def _measured(self) -> Bounds:
        scale = self.task.paper_beta if self.kind == "mu" and self.grasp is not None else None
        return self.mu.of_measure(self.kind, scale)

    @property
    def _quality(self) -> Quality:
        return Quality(self._measured, self.kind, self.delta, self.nu, self.robust, self.bound, self.needed)

"""Options of a solve, checked at construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number, share
from nlpgrasp.errors import InputError
from nlpgrasp.nlp.ipopt import check_ipopt_options
from nlpgrasp.quality.own_measures import OWN_MEASURES
from nlpgrasp.solution.kept_grasps import weighs_fragility
from nlpgrasp.solution.obstructions import MOST_TOLERANCE

RANKS = ("robust", "mu")  # measures by which the answer is chosen
ANALYSES = {
    "prices": "shadow prices",
    "robustness": "robustness",
    "delta": "delta",
    "nu": "nu",
    "friction": "critical friction",
    "phases": "phases of the hand",
    "drawing": "the drawing",
}  # from an analysis to its name in messages
METHODS = "steps", "program"  # of refinement
GAP_SHARE = 0.2  # share of the requested gap that certificates may take


@dataclass(frozen=True)
class SolveOptions:
    """Options of a solve, checked at construction.

    Parameters
    ----------
    method : {"steps", "program"}
        How a candidate becomes a local optimum. ``"steps"``: by quadratic programs in a trust region, where mu is
        evaluated at every step. ``"program"``: by IPOPT on the program (3.5-4) as the paper states it, whose directions
        join by need (``Formulation.solve(refine=True)``); slower, and not with a hand that has a pose.
    rounds : int
        Most rounds of the refinement of a candidate: with 0 candidates stay where they were proposed.
    rtol : float
        Relative gap of each start's certificate.
    final_rtol : float
        Relative gap of the answer's certificate.
    link_tolerance : float
        Largest allowed depth of a hand's link in the body, a table or an obstacle, metres, by the link's own collision
        shapes: a grasp whose links are deeper is not called solved. At most 0.01.
    pregrasp_clearance : float
        Clearance to which the fingers of a hand with a pose open for the pregrasp, metres.
    analyses : sequence of str
        Analyses of the answer, by the names of ``ng.analyse``: ``"prices"``, ``"robustness"``, ``"delta"``, ``"nu"``,
        ``"friction"``, ``"phases"``, ``"drawing"``. Each can be added to a solution later.
    extras : bool
        Whether to run all analyses.
    robust_offset : float
        Largest displacement of contacts in the robustness stated of every solution, metres.
    robust_friction : float
        Share by which friction may be less in that robustness, below 1.
    rank : {"robust", "mu"}
        Selection of the answer among the starts. ``"mu"``: the one with the best mu. ``"robust"``: the same, but where
        less than a fifth of that mu remains under the worst displacement, the best of the next two grasps that is not
        so fragile, has at least half its mu and retains more; where less than half remains, one with 0.95 of its mu.
        Where the joints of a hand cannot squeeze the best, grasps that they can squeeze go before it, with half its
        mu. With a ``gap``, with ``maximise_robust``, or after the time limit, mu alone counts.
    joint_margin : float
        Margin of the joints of a hand with links from their limits, radians, 0 for none: at most a tenth of a joint's
        range, and exactly that for prismatic joints. Grasps are refined with the ranges narrowed by it. Not with a
        ``gap``, where mu alone counts.
    room_price : float
        The share of mu that the margins may cost, below 1; where they cost more, joints stay near their limits, and
        the solution names them.
    maximise_robust : bool
        Move the contacts to maximise the quality under the worst displacement (on smooth bodies, without a hand that
        has a pose), and take the start with the best such quality instead of the one with the best mu.
    global_bound : bool
        Bound mu over all grasps, by a branch and bound of up to four seconds after the starts. Without it the distance
        of the answer from the best possible is unknown.
    gap : float, optional
        Continue the search over all grasps after the starts until the answer is proved to be this close to the best
        possible (a share above 0, at most 1), or until the time limit. Without it a short search states a bound.
    edge_margin : float, optional
        In place of the problem's: least distance of contacts from sharp edges, metres, 0 for none.
    time_limit : float, optional
        Seconds of wall time for the whole solve; the best grasp so far is returned.
    workers : int, optional
        Number of processes: one for each core if left out, 1 for this process only. The result does not depend on it.
    ipopt : mapping
        Options of IPOPT by their own names, in place of the package's: ``{"linear_solver": "mumps", "max_iter": 50}``.
    """

    method: str = "steps"
    rounds: int = 25
    rtol: float = 0.03
    final_rtol: float = 0.01
    link_tolerance: float = 0.001
    pregrasp_clearance: float = 0.01
    analyses: Sequence[str] = ()
    extras: bool = False
    robust_offset: float = 0.001
    robust_friction: float = 0.1
    rank: str = "robust"
    joint_margin: float = 0.052
    room_price: float = 0.03
    maximise_robust: bool = False
    global_bound: bool = True
    gap: float | None = None
    edge_margin: float | None = None
    time_limit: float | None = None
    workers: int | None = None
    ipopt: Mapping[str, bool | int | float | str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not isinstance(self.rank, str) or self.rank not in RANKS:
            raise InputError("SolveOptions.rank", self.rank, " or ".join(map(repr, RANKS)))
        if not isinstance(self.method, str) or self.method not in METHODS:
            raise InputError("SolveOptions.method", self.method, " or ".join(map(repr, METHODS)))
        object.__setattr__(self, "rounds", integer("SolveOptions.rounds", self.rounds, at_least=0, at_most=1000))
        for name in ("rtol", "final_rtol", "pregrasp_clearance"):
            object.__setattr__(self, name, number(f"SolveOptions.{name}", getattr(self, name), above=0.0))
        for name in ("link_tolerance", "robust_offset", "robust_friction", "joint_margin", "room_price"):
            object.__setattr__(self, name, number(f"SolveOptions.{name}", getattr(self, name), at_least=0.0))
        if self.link_tolerance > MOST_TOLERANCE:
            raise InputError("SolveOptions.link_tolerance", self.link_tolerance, f"at most {MOST_TOLERANCE:g} m")
        for name in ("robust_friction", "room_price"):
            if getattr(self, name) >= 1.0:
                raise InputError(f"SolveOptions.{name}", getattr(self, name), "a share below 1")
        if self.time_limit is not None:
            limit = number("SolveOptions.time_limit", self.time_limit, above=0.0)
            object.__setattr__(self, "time_limit", limit)
        if self.edge_margin is not None:
            margin = number("SolveOptions.edge_margin", self.edge_margin, at_least=0.0)
            object.__setattr__(self, "edge_margin", margin)
        if self.gap is not None:
            object.__setattr__(self, "gap", share("SolveOptions.gap", self.gap))
            if not self.global_bound:
                raise InputError("SolveOptions.gap", self.gap, "no gap with global_bound=False")
        if self.workers is not None:
            workers = integer("SolveOptions.workers", self.workers, at_least=1, at_most=1024)
            object.__setattr__(self, "workers", workers)
        object.__setattr__(self, "analyses", check_analyses("SolveOptions.analyses", self.analyses))
        if self.ipopt != {}:
            object.__setattr__(self, "ipopt", check_ipopt_options("SolveOptions.ipopt", self.ipopt))
        for name in ("extras", "maximise_robust", "global_bound"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"SolveOptions.{name}", getattr(self, name), "True or False")

    @property
    def weighs_fragility(self) -> bool:
        """Whether a robust grasp with less mu may be preferred to a fragile one."""
        return weighs_fragility(self.to_dict())

    @property
    def seeks_room(self) -> bool:
        """Whether mu may be traded for joint-limit margins."""
        return self.joint_margin > 0.0 and self.gap is None

    def narrow(self) -> SolveOptions:
        """Return the options with certificates narrowed to the requested gap."""
        gap = inf if self.gap is None else GAP_SHARE * self.gap
        return replace(self, rtol=min(self.rtol, gap), final_rtol=min(self.final_rtol, gap))

    def to_dict(self) -> Json:
        """Return the options as JSON data, by field name; IPOPT's options only if any are set."""
        data = {name: getattr(self, name) for name in self.__dataclass_fields__} | {"analyses": list(self.analyses)}
        return data if self.ipopt else {name: value for name, value in data.items() if name != "ipopt"}


def check_solve_arguments(starts: int, seed: int, options: SolveOptions | None) -> tuple[int, int, SolveOptions]:
    """Return the validated number of starts, seed and options of a solve.

    Raises
    ------
    InputError
        For numbers out of range, and for options that are not a SolveOptions.
    """
    starts = integer("starts", starts, at_least=1, at_most=10**6)
    seed = integer("seed", seed, at_least=0, at_most=10**15)
    options = SolveOptions() if options is None else options
    if not isinstance(options, SolveOptions):
        raise InputError("options", options, "a SolveOptions, such as ng.SolveOptions(gap=0.02)")
    return starts, seed, options


def check_analyses(field: str, names: object) -> tuple[str, ...]:
    """Return the validated names of analyses, each once.

    An ``InputError`` lists the allowed names.
    """
    known = [*ANALYSES, *OWN_MEASURES]
    allowed = ", ".join(f'"{name}"' for name in known)
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise InputError(field, names, f"a sequence of names out of {allowed}")
    for name in names:
        if name not in known:
            raise InputError(field, name, allowed)
    return tuple(dict.fromkeys(names))

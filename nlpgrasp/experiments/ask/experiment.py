"""Experiment: one base problem, named variations and seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.variation import Case, Variation, case_of, settled_changes
from nlpgrasp.optimize import SolveOptions
from nlpgrasp.optimize.many.collection import Keeping
from nlpgrasp.pipeline.solve import check_json
from nlpgrasp.problem.problem import GraspProblem


@dataclass(frozen=True, order=True)
class SolveId:
    """Identifier of one solve: variation and seed.

    Parameters
    ----------
    variation : str
    seed : int
    """

    variation: str
    seed: int

    def __str__(self) -> str:
        return f"{self.variation}, seed {self.seed}"


@dataclass(frozen=True)
class Experiment:
    """A base problem and named variations of it, each solved with several seeds.

    Parameters
    ----------
    base : GraspProblem
        Problem that the variations change.
    variations : mapping of str to mapping, GraspProblem or callable; or a sequence of such pairs
        By name, the fields of the base problem that are replaced. Besides the fields of
        ``GraspProblem`` these are known: ``friction`` (of all contacts), ``fingers`` (how many, where
        the base's contacts are alike), ``starts``, and ``options`` (``SolveOptions``, or a mapping
        of some of its fields). A whole problem replaces the base. A function without arguments that returns either is
        called in the worker that solves it: for hundreds of meshes that should not all be in memory.
        ``ng.combinations`` makes combinations of several factors.
    seeds : iterable of int
        Each variation is solved once with each seed.
    starts : int
        Of each solve.
    options : SolveOptions, optional
        ``workers`` is ignored: solves run in parallel, each in one process. So is ``rank``: variations and their starts
        are compared by mu.
    name : str, optional
        The base problem's when left out.
    keep, distinct : int, float
        For each solve, as in ``ng.solve``. A grasp taken from another variation is kept alone.

    Raises
    ------
    InputError
        On two variations of one name, and on invalid problems; only functions may fail later.
    """

    base: GraspProblem
    variations: Mapping[str, Variation] | Sequence[tuple[str, Variation]]
    seeds: Iterable[int] = (0,)
    starts: int = 8
    options: SolveOptions | None = None
    name: str | None = None
    keep: int = 1
    distinct: float = 0.1
    _base: Case = field(init=False, repr=False, compare=False)
    _by_name: dict[str, Variation] = field(init=False, repr=False, compare=False)
    _cases: dict[str, Case] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.base, GraspProblem):
            raise InputError("Experiment.base", self.base, "a GraspProblem")
        integer("Experiment.starts", self.starts, at_least=1, at_most=10**6)
        options = SolveOptions() if self.options is None else self.options
        if not isinstance(options, SolveOptions):
            raise InputError("Experiment.options", options, "a SolveOptions")
        base = Case(self.base, self.starts, replace(options, workers=1), Keeping(self.keep, self.distinct))
        object.__setattr__(self, "_base", base)
        object.__setattr__(self, "name", self.base.name if self.name is None else self.name)
        if not isinstance(self.name, str) or not self.name.strip() or not self.name.isprintable():
            raise InputError("Experiment.name", repr(self.name), "a text of printable characters")
        object.__setattr__(self, "seeds", check_seeds(self.seeds))
        self._set_variations()
        for variation, changes in self._by_name.items():
            if not callable(changes):
                case = case_of(f"Experiment.variations[{variation!r}]", base, changes)
                check_json(case.problem.to_dict())
                self._cases[variation] = case

    def _set_variations(self) -> None:
        given = self.variations
        try:
            pairs = [(n, v) for n, v in (given.items() if isinstance(given, Mapping) else given)]
        except (TypeError, ValueError):
            raise InputError("Experiment.variations", given, "a mapping, or a sequence of names and values") from None
        check_names([name for name, _ in pairs])
        settled = {n: settled_changes(v) if isinstance(v, Mapping) else v for n, v in pairs}
        object.__setattr__(self, "variations", settled)
        object.__setattr__(self, "_by_name", settled)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variations, in their order."""
        return tuple(self._by_name)

    @property
    def solves(self) -> tuple[SolveId, ...]:
        """All solves, grouped by variation, as workers keep the programs of the last variation."""
        return tuple(SolveId(name, seed) for name in self.names for seed in self.seeds)

    def deferred(self, name: str) -> bool:
        """Return whether a variation is a function that is called where it is solved."""
        return name not in self._cases

    def case(self, name: str) -> Case:
        """Return the problem and options of a variation; a deferred one is created now.

        Raises
        ------
        InputError
            When the function of a deferred variation returns something that defines no problem.
        """
        return self.maker(name)()

    def maker(self, name: str) -> Callable[[], Case]:
        """Return a function that creates the case of a variation without the rest of the experiment, for a worker."""
        if self.deferred(name):
            return partial(case_of, f"Experiment.variations[{name!r}]", self._base, self._by_name[name])
        return partial(_given, self._cases[name])


def check_names(names: Sequence[object]) -> None:
    """Refuse variation names that cannot be displayed or distinguished."""
    if not names:
        raise InputError("Experiment.variations", "none", "at least one variation")
    for name in names:
        if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 200:
            raise InputError("Experiment.variations", repr(name), "names of 1 to 200 printable characters")
    twice = [name for name, count in Counter(" ".join(str(n).split()) for n in names).items() if count > 1]
    if twice:
        raise InputError("Experiment.variations", f"two variations named {twice[0]!r}", "each name once")


def check_seeds(given: object) -> tuple[int, ...]:
    """Return validated integer seeds.

    Raises
    ------
    InputError
        On an empty list, values other than integers, or a repeated seed.
    """
    try:
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise TypeError
        values = tuple(given)
    except TypeError:
        raise InputError("Experiment.seeds", given, "whole numbers") from None
    seeds = tuple(integer("Experiment.seeds", s, at_least=0, at_most=10**15) for s in values)
    if not seeds or len(set(seeds)) < len(seeds):
        raise InputError("Experiment.seeds", list(seeds), "at least one whole number, none twice")
    return seeds


def _given(case: Case) -> Case:
    return case

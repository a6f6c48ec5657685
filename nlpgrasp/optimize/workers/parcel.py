"""Worker payload: a problem sent to worker processes many times and unpacked once in each."""

from __future__ import annotations

import sys
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar, cast

import cloudpickle

from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.problem.problem import GraspProblem


class Asked(Protocol):
    """Protocol of a problem with its solve options."""

    @property
    def problem(self) -> GraspProblem:
        """Problem to solve."""

    @property
    def options(self) -> SolveOptions:
        """Options of the solve."""


Case = TypeVar("Case", bound=Asked)
Item = TypeVar("Item")
_unpacked: dict[str, object] = {}  # in this process: the item of the last parcel


@dataclass(frozen=True)
class Parcel(Generic[Item]):
    """Pickled payload for worker processes, with the caller's import path.

    Parameters
    ----------
    token : str
        The same for all parcels of one item: a process unpacks it once, and keeps it until another comes.
    path : tuple of str
        The caller's ``sys.path``.
    content : bytes
        The item.
    """

    token: str
    path: tuple[str, ...]
    content: bytes

    @classmethod
    def of(cls, item: Item, token: str = "") -> Parcel[Item]:
        """Pickle an item; errors of its parts are raised."""
        return cls(token or uuid.uuid4().hex, tuple(sys.path), bytes(cloudpickle.dumps(item)))

    def unpacked(self) -> Item:
        """Return the item in this process."""
        if self.token not in _unpacked:
            _unpacked.clear()  # before the next one is built: each may hold a gigabyte
            sys.path.extend(entry for entry in self.path if entry not in sys.path)  # before its modules are imported
            _unpacked[self.token] = cloudpickle.loads(self.content)
        return cast("Item", _unpacked[self.token])


@dataclass(frozen=True)
class LazyBench(Generic[Case]):
    """Compiled problem, built on first use in each process: compiled programs are not pickled.

    Parameters
    ----------
    make : callable
        Returns what is asked; called once in a process.
    """

    make: Callable[[], Case]

    @cached_property
    def case(self) -> Case:
        """Problem and options, made in this process."""
        return self.make()

    @cached_property
    def bench(self) -> Workbench:
        """Compiled problem."""
        return Workbench(self.case.problem, self.case.options)

"""What is sent to worker processes many times and unpacked once in each: a problem with its programs."""

from __future__ import annotations

import sys
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar, cast

import cloudpickle

from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.workbench.workbench import Workbench


class Asked(Protocol):
    """A problem and how it is solved."""

    @property
    def problem(self) -> GraspProblem:
        """Problem that is to be solved."""

    @property
    def options(self) -> SolveOptions:
        """Options that it is solved with."""


Case = TypeVar("Case", bound=Asked)
Item = TypeVar("Item")
_unpacked: dict[str, object] = {}  # in this process: the item of the last parcel


@dataclass(frozen=True)
class Parcel(Generic[Item]):
    """An item on its way to other processes, with the caller's import path: a script may have imported its neighbours.

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
        """Pack an item; whatever its parts raise when they are pickled is raised."""
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
    """A problem's workbench, built in each process where it is first asked for: programs do not travel.

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
        """The workbench of the problem."""
        return Workbench(self.case.problem, self.case.options)

"""Tables of quality measures: a row for each grasp, friction coefficient and task."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.budgets import ForceBudget, force_budget
from nlpgrasp.common.files import write_text
from nlpgrasp.common.validation import FloatArray, format_known_names, number
from nlpgrasp.contacts import ContactModel, FrictionContact, PointContact
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.quality.other_measures import ferrari_canny, isotropy, min_weight, smallest_singular_value
from nlpgrasp.quality.own_measures import OWN_MEASURES
from nlpgrasp.quality.volume import nu
from nlpgrasp.tasks import Task

if TYPE_CHECKING:
    import pandas as pd

Column = NDArray[np.generic]
Frictions = float | Sequence[float] | None
DEFAULT = ("mu", "delta", "epsilon")  # measures of a table


@dataclass(frozen=True)
class Columns(Mapping[str, Column]):
    """Table as a mapping of column names to arrays of one length, used where pandas is not installed.

    Parameters
    ----------
    arrays : dict of str to (m,) array
        One entry for each of m rows.
    """

    arrays: dict[str, Column]

    def __getitem__(self, name: str) -> Column:
        return self.arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays)

    def rows(self) -> list[dict[str, object]]:
        """Return the rows as dictionaries."""
        columns = [column.tolist() for column in self.arrays.values()]
        return [dict(zip(self.arrays, row, strict=True)) for row in zip(*columns, strict=True)]

    def to_csv(self, path: str | Path | None = None) -> str:
        """Return the table as CSV text, with an empty cell for NaN, and write it to a file if a path is given."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.arrays)
        for row in self.rows():
            writer.writerow(["" if value != value else value for value in row.values()])
        if path is not None:
            write_text(path, text.getvalue())
        return text.getvalue()

    def __repr__(self) -> str:
        count = len(next(iter(self.arrays.values()), ()))
        return f"Columns({count} rows: {', '.join(self.arrays)})"


@dataclass(frozen=True)
class _Settings:
    """Settings that the measures of a table share."""

    torque_scale: float
    force_budget: str | ForceBudget
    rtol: float


Result = Bounds | StackBounds | tuple[Bounds, ...] | float | FloatArray
Evaluation = Callable[[Grasp | GraspStack, Task | None, _Settings], Result]


@dataclass(frozen=True)
class _Measure:
    """Entry of ``MEASURES``: evaluation of a quality measure, and what it needs and yields."""

    evaluate: Evaluation
    needs_task: bool = False
    needs_scale: bool = False  # a torque scale
    numbers: tuple[str, ...] = ("lower", "upper")  # numbers of the result, a column each; one column without any
    zero: str = ""  # flag of grasps whose upper bound is 0


def _mu(grasp: Grasp | GraspStack, task: Task | None, settings: _Settings) -> Result:
    """Return mu of a grasp or a stack; raise an ``InputError`` without a task."""
    if task is None:
        raise InputError("task", None, "a task for mu, such as ng.TaskEllipsoid")
    return mu(grasp, task, settings.rtol, force_budget=settings.force_budget)


NOT_CLOSED = "not force-closed"
MEASURES = {
    "mu": _Measure(_mu, needs_task=True, zero="cannot exert the task"),
    "delta": _Measure(
        lambda g, _, s: delta(g, s.torque_scale, s.rtol, force_budget=s.force_budget),
        needs_scale=True,
        zero=NOT_CLOSED,
    ),
    "epsilon": _Measure(
        lambda g, _, s: delta(g, s.torque_scale, s.rtol, force_budget="shared"), needs_scale=True, zero=NOT_CLOSED
    ),
    "nu": _Measure(
        lambda g, _, s: nu(g, s.torque_scale, s.rtol, force_budget=s.force_budget),
        needs_scale=True,
        numbers=("lower", "upper", "value", "error"),
        zero="its wrenches have no volume",
    ),
    "ferrari_canny": _Measure(
        lambda g, _, s: ferrari_canny(g, torque_scale=s.torque_scale), needs_scale=True, numbers=()
    ),
    "min_weight": _Measure(lambda g, _, s: min_weight(g), numbers=()),
    "isotropy": _Measure(lambda g, _, s: isotropy(g, s.torque_scale), needs_scale=True, numbers=()),
    "smallest_singular_value": _Measure(
        lambda g, _, s: smallest_singular_value(g, s.torque_scale), needs_scale=True, numbers=()
    ),
}


def _entry(name: str) -> _Measure:
    """Return the entry of a measure, one from outside among them."""
    if name in MEASURES:
        return MEASURES[name]
    measure = OWN_MEASURES[name]

    def evaluate(grasps: Grasp | GraspStack, task: Task | None, settings: _Settings) -> Result:
        budget = force_budget(settings.force_budget)
        stack = grasps if isinstance(grasps, GraspStack) else [grasps]
        return np.array([measure.value(grasp, task, budget) for grasp in stack])

    return _Measure(evaluate, numbers=())


def measure(
    grasps: GraspStack | Sequence[GraspStack],
    task: Task | Mapping[str, Task] | Sequence[Task] | None = None,
    measures: Sequence[str] = DEFAULT,
    *,
    friction: Frictions = None,
    torque_scale: float | None = None,
    force_budget: str | ForceBudget = "l2",
    rtol: float = 0.05,
) -> pd.DataFrame | Columns:
    """Return a table of quality measures, with a row for each grasp, friction coefficient and task.

    Columns: ``id``, ``contacts`` (their number), ``friction`` (NaN where the contacts of a grasp differ), ``task``,
    ``torque_scale`` (metres). For a certified measure ``NAME_lower``, ``NAME_upper``, ``NAME_flag`` and
    ``NAME_seconds``, for others ``NAME``, ``NAME_flag`` and ``NAME_seconds``. ``nu_value`` and ``nu_error`` are the
    estimate of nu and its error bar. The flag is empty, or says that a grasp is certainly not closed, why an interval
    is wider than ``rtol``, or why there is no number (NaN). Seconds are the mean over the grasps that were measured
    together. Measures without a task are repeated for every task.

    Parameters
    ----------
    grasps : GraspStack or sequence of GraspStack
        Several for grasps with different contacts, about one torque origin; the rows are in their order.
    task : Task, mapping of str to Task, or sequence of Task, optional
        Needed for ``mu``; a sequence is named ``task 0``, ``task 1``, ...
    measures : sequence of str
        Of ``mu``, ``delta``, ``epsilon`` (Ferrari and Canny's, of the exact cones: delta with the shared budget),
        ``nu`` and, not certified, ``ferrari_canny`` (pyramids of 8 edges), ``min_weight``, ``isotropy`` and
        ``smallest_singular_value``; of those from outside by name (``GraspMeasure``).
    friction : float or sequence of float, optional
        Coefficients that replace those of all contacts, each in turn; by default those of the stacks.
    torque_scale : float, optional
        Metres, one for the whole table: a torque counts as the force ``torque / torque_scale``. By default the root
        mean square distance of all contacts of the table from the torque origin.
    force_budget : str or ForceBudget
        Of ``mu``, ``delta`` and ``nu``, as for ``mu``.
    rtol : float
        Relative width of certified intervals.

    Returns
    -------
    pandas.DataFrame, or Columns
        Columns where pandas is not installed.

    Raises
    ------
    InputError
        On an unknown measure, ``mu`` without a task, stacks about different torque origins, and contacts that have no
        friction coefficient where ``friction`` is given.
    """
    columns = measure_columns(grasps, task, measures, friction, torque_scale, force_budget, rtol)
    try:
        frame: pd.DataFrame = import_module("pandas").DataFrame(columns.arrays)
    except ImportError:
        return columns
    return frame


def measure_columns(
    grasps: GraspStack | Sequence[GraspStack],
    task: Task | Mapping[str, Task] | Sequence[Task] | None,
    measures: Sequence[str],
    friction: Frictions,
    torque_scale: float | None,
    force_budget: str | ForceBudget,
    rtol: float,
) -> Columns:
    """Return the table of ``measure`` as ``Columns``."""
    stacks, names = _stacks(grasps), _measure_names(measures)
    tasks = _tasks(task)
    if task is None and any(_entry(name).needs_task for name in names):
        raise InputError("task", None, "a task for mu, such as ng.TaskEllipsoid; or measures without it")
    has_scale = any(_entry(name).needs_scale for name in names)
    scale = common_arm(stacks) if torque_scale is None else number("torque_scale", torque_scale, above=0.0)
    settings = _Settings(scale, force_budget, number("rtol", rtol, above=0.0))
    parts = []
    for stack in stacks:
        for coefficient in _frictions(friction):
            adapted = stack if coefficient is None else stack.with_contacts(_with_friction(stack.contacts, coefficient))
            parts += _rows(adapted, tasks, names, settings, has_scale)
    return Columns({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def common_arm(stacks: Sequence[GraspStack]) -> float:
    """Return the root mean square distance of all contacts from the torque origin, metres; 1 if it is zero."""
    squares = [np.sum((stack.points - stack.torque_origin) ** 2, axis=2).ravel() for stack in stacks]
    return float(np.sqrt(np.mean(np.concatenate(squares)))) or 1.0


def _stacks(grasps: GraspStack | Sequence[GraspStack]) -> tuple[GraspStack, ...]:
    """Return the validated stacks of a table, which share a torque origin."""
    stacks = (grasps,) if isinstance(grasps, GraspStack) else tuple(grasps) if isinstance(grasps, Sequence) else ()
    if not stacks or not all(isinstance(stack, GraspStack) and len(stack) for stack in stacks):
        raise InputError("grasps", grasps, "a GraspStack that is not empty, or several")
    for stack in stacks[1:]:
        if not np.array_equal(stack.torque_origin, stacks[0].torque_origin):
            origins = f"torque origins {stacks[0].torque_origin.tolist()} and {stack.torque_origin.tolist()}"
            raise InputError("grasps", origins, "stacks about one torque origin")
    return stacks


def _measure_names(measures: Sequence[str]) -> tuple[str, ...]:
    """Return the validated names of measures, each once."""
    names = (measures,) if isinstance(measures, str) else tuple(measures)
    known = (*MEASURES, *OWN_MEASURES)
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        given = unknown[0] if unknown else "none"
        raise InputError("measures", given, f"some of {format_known_names(unknown, known)}")
    return tuple(dict.fromkeys(names))


def _tasks(task: Task | Mapping[str, Task] | Sequence[Task] | None) -> dict[str, Task | None]:
    """Return the validated tasks of a table by name; None stands for a table without tasks."""
    if task is None:
        return {"": None}
    if isinstance(task, Task):
        return {"task": task}
    named = dict(task) if isinstance(task, Mapping) else {f"task {i}": t for i, t in enumerate(task)}
    if not named or not all(isinstance(t, Task) for t in named.values()):
        raise InputError("task", task, "a task, several, or a mapping of names to tasks")
    return {str(name): t for name, t in named.items()}


def _frictions(friction: Frictions) -> tuple[float | None, ...]:
    """Return the validated friction coefficients of a table; None stands for those of the contacts."""
    if friction is None:
        return (None,)
    values: Iterable[float] = friction if isinstance(friction, Sequence | np.ndarray) else (friction,)
    coefficients = tuple(number("friction", value, above=0.0) for value in values)
    if not coefficients:
        raise InputError("friction", "none", "a coefficient above 0, or several")
    return coefficients


def _with_friction(contacts: Sequence[ContactModel], friction: float) -> list[ContactModel]:
    """Return contact models with another friction coefficient.

    Frictionless points become points with friction.
    """
    result: list[ContactModel] = []
    for model in contacts:
        if isinstance(model, PointContact):
            result.append(FrictionContact(friction))
        elif "friction" in model.coefficients:
            result.append(model.with_coefficients(friction=friction))
        else:
            raise InputError("friction", f"{friction:g} for a {model.label} contact", "contacts that have a friction")
    return result


def _rows(
    stack: GraspStack, tasks: Mapping[str, Task | None], names: Sequence[str], settings: _Settings, has_scale: bool
) -> list[dict[str, Column]]:
    """Return the table's columns for one stack, a dictionary for each task."""
    count = len(stack)
    coefficients = {model.coefficients.get("friction", 0.0) for model in stack.contacts}
    friction = coefficients.pop() if len(coefficients) == 1 else np.nan
    without_task = {name: _columns(name, stack, None, settings) for name in names if not _entry(name).needs_task}
    parts = []
    for task_name, task in tasks.items():
        part: dict[str, Column] = {
            "id": np.array(stack.ids, dtype=object),
            "contacts": np.full(count, len(stack.contacts)),
            "friction": np.full(count, friction),
        }
        if task is not None:
            part["task"] = np.full(count, task_name, dtype=object)
        if has_scale:
            part["torque_scale"] = np.full(count, settings.torque_scale)
        for name in names:
            part |= without_task[name] if name in without_task else _columns(name, stack, task, settings)
        parts.append(part)
    return parts


def _columns(name: str, stack: GraspStack, task: Task | None, settings: _Settings) -> dict[str, Column]:
    """Return the table's columns of one measure for the grasps of a stack."""
    kind, begin = _entry(name), time.perf_counter()
    try:
        parts = [_values(kind.evaluate(stack, task, settings), kind)]
    except InputError:
        raise
    except NlpgraspError:  # of some grasp: each by itself
        parts = [_values_of_grasp(kind, grasp, task, settings) for grasp in stack]
    numbers, flags = (np.concatenate(column) for column in zip(*parts, strict=True))
    names = [f"{name}_{number}" for number in kind.numbers] or [name]
    seconds = np.full(len(stack), (time.perf_counter() - begin) / len(stack))
    return {**dict(zip(names, numbers.T, strict=True)), f"{name}_flag": flags, f"{name}_seconds": seconds}


def _values_of_grasp(kind: _Measure, grasp: Grasp, task: Task | None, settings: _Settings) -> tuple[FloatArray, Column]:
    """Return the numbers and flag of one grasp; NaN, with the reason as flag, where it cannot be measured."""
    try:
        return _values(kind.evaluate(grasp, task, settings), kind)
    except InputError:
        raise
    except NlpgraspError as error:
        return np.full((1, len(kind.numbers) or 1), np.nan), np.array([str(error)], dtype=object)


def _values(result: Result, kind: _Measure) -> tuple[FloatArray, Column]:
    """Return the numbers, (b, m), and the flags, (b,), from the result of a measure."""
    if isinstance(result, StackBounds):
        bounds: Sequence[Bounds] = list(result)
    elif isinstance(result, Bounds):
        bounds = [result]
    elif isinstance(result, tuple):
        bounds = result
    else:
        values = np.atleast_1d(np.asarray(result, dtype=float))
        return values[:, None], np.full(len(values), "", dtype=object)
    flags = [b.limit or (kind.zero if b.upper == 0.0 else "") for b in bounds]
    numbers = [[float(getattr(b, number)) for number in kind.numbers] for b in bounds]
    return np.array(numbers), np.array(flags, dtype=object)

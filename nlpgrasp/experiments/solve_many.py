"""Solution of many problems in one call, with the distinct grasps of each in a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import Experiment, SolveId
from nlpgrasp.experiments.experiment_run import Progress, run_solves
from nlpgrasp.experiments.output_folder import OutputFolder
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution

EXPERIMENT_NAME = "many problems"  # name of the folder's experiment
ProblemFactory = Callable[[], GraspProblem]


@dataclass(frozen=True)
class ManySolved:
    """Result of solving many problems.

    Parameters
    ----------
    folder : Path
        Folder of the solution files.
    files : mapping of str to Path
        Solution file of each problem that has one, with or without a grasp.
    failures : mapping of str to str
        Reason for a missing solution, by problem.
    grasps : int
        Number of grasps in all files.
    new : int
        Number of grasps found by this call.
    seconds : float
        Wall time of this call.
    notes : tuple of str
        Further messages.
    """

    folder: Path
    files: Mapping[str, Path]
    failures: Mapping[str, str]
    grasps: int
    new: int
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether every problem has a solution."""
        return not self.failures

    @property
    def per_second(self) -> float:
        """Number of grasps found per second of this call."""
        return self.new / self.seconds if self.seconds > 0.0 else 0.0

    def load(self, name: str) -> GraspSolution:
        """Load the solution of a problem.

        Raises
        ------
        InputError
            On a name without a solution, and on a file that cannot be read.
        """
        if name not in self.files:
            raise InputError("name", name, "a problem that has a solution: " + ", ".join(self.files))
        return GraspSolution.load(self.files[name])

    def __str__(self) -> str:
        rate = f", {self.per_second:.2g} grasps/s" if self.new else ""
        lines = [
            f"{self.grasps} grasps of {len(self.files)} problems in {self.folder}",
            f"  {self.new} of them found now, in {self.seconds:.1f} s{rate}",
        ]
        lines += [f"  {name}: {reason}" for name, reason in self.failures.items()]
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])


def solve_many(
    problems: Mapping[str, GraspProblem | ProblemFactory] | Iterable[GraspProblem],
    out: str | Path,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    keep: int = 20,
    distinct: float = 0.1,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> ManySolved:
    """Solve many problems in parallel, and write the distinct grasps of each to a file.

    The folder is that of an experiment (docs/experiments.md): ``solves/NAME--seed0.json`` is the solution file of a
    problem, written atomically once solved. An existing folder is resumed: problems with a file are not solved again,
    and problems may be added.

    Parameters
    ----------
    problems : mapping of str to GraspProblem or callable, or iterable of GraspProblem
        By name; for an iterable, by the problems' own names. A function without arguments that returns a problem is
        called in the worker that solves it: for hundreds of meshes that should not all be in memory.
    out : str or Path
        Folder for the files.
    starts, seed, options, keep, distinct
        For each solve, as in ``ng.solve``; each runs in one process.
    workers : int, optional
        Processes on this machine; one a core when left out.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers solve instead (extra ``cluster``).
    progress : callable, optional
        Called with the record of each solve as it is done.

    Returns
    -------
    ManySolved
        Also after Ctrl-C and with failures: it lists them.

    Raises
    ------
    InputError
        Before anything runs: on arguments that ``ng.solve`` refuses, two problems of one name, and a folder of other
        problems or settings, or with other files.
    MissingExtraError
        For a scheduler without the extra ``cluster``.
    """
    start_time = time.monotonic()
    problem_by_name = check_named_problems(problems)
    base = next(iter(problem_by_name.values()))
    if not isinstance(base, GraspProblem):
        base = base()
        if not isinstance(base, GraspProblem):
            raise InputError("problems", base, "functions that return a GraspProblem")
    experiment = Experiment(base, problem_by_name, [seed], starts, options, EXPERIMENT_NAME, keep, distinct)
    output = OutputFolder(out)
    result = run_solves(experiment, output, True, workers, scheduler, progress, is_compared=False)
    solved = [record for record in result.solves if record.done]
    return ManySolved(
        output.path,
        {record.variation: output.solution_file(SolveId(record.variation, seed)) for record in solved},
        {record.variation: record.failure for record in result.failures},
        sum(record.grasps for record in solved),
        sum(record.grasps for record in solved if not record.earlier),
        time.monotonic() - start_time,
        result.notes,
    )


def check_named_problems(problems: object) -> dict[str, GraspProblem | ProblemFactory]:
    """Return validated problems or problem functions by name, from a mapping or from several problems."""
    allowed = "problems by name, or several problems of different names"
    if isinstance(problems, Mapping):
        problem_by_name = dict(problems)
    elif isinstance(problems, Iterable) and not isinstance(problems, str):
        problem_by_name = {}
        for problem in problems:
            if not isinstance(problem, GraspProblem):
                raise InputError("problems", problem, allowed)
            if problem.name in problem_by_name:
                raise InputError("problems", f"two problems named {problem.name!r}", allowed)
            problem_by_name[problem.name] = problem
    else:
        raise InputError("problems", problems, allowed)
    if not problem_by_name:
        raise InputError("problems", "none", "at least one")
    for name, problem in problem_by_name.items():
        if isinstance(problem, type) or not (isinstance(problem, GraspProblem) or callable(problem)):
            raise InputError(f"problems[{name!r}]", problem, "a GraspProblem, or a function that returns one")
    return problem_by_name

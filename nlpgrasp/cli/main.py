"""Command line: registration of all commands, and the commands ``solve``, ``verify``, ``demo`` and ``program``.

Exit codes: 0 done, 1 no grasp found or verification failed, 2 wrong use or bad input.
"""

from __future__ import annotations

import io
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NoReturn

import typer

import nlpgrasp as ng
from nlpgrasp.cli.bound_command import bound_command
from nlpgrasp.cli.console import (
    AsJson,
    File,
    Folders,
    Reporter,
    Rtol,
    Script,
    bounds_pair,
    final_record,
    writable,
    write_json_line,
)
from nlpgrasp.cli.experiment_command import experiment_command
from nlpgrasp.cli.export_command import export_command
from nlpgrasp.cli.hand_command import hand_command
from nlpgrasp.cli.parts_command import parts_command
from nlpgrasp.cli.problem_script import WITH_MODULE, load_modules, load_problem
from nlpgrasp.cli.proof_commands import check_command, prove_command
from nlpgrasp.cli.quality_command import quality_command
from nlpgrasp.cli.report_command import report_command
from nlpgrasp.cli.set_command import set_app
from nlpgrasp.cli.simulate_command import simulate_command
from nlpgrasp.cli.task_command import task_app
from nlpgrasp.common.display import open_page
from nlpgrasp.common.validation import integer, share
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.version import __version__

DEMO_STARTS = 4  # of the demo
INTRODUCTION = """A box of 80 x 40 x 40 mm stands on a table. Four round fingertips of 8 mm, friction 0.6, are to exert
10 N along z, 5 N across and 0.2 N m of torque on it, either way. Where should they touch it?
"""
INTERRUPTED_CODE = 130  # what typer makes of Ctrl-C
# typer brings a click of its own; this is its UsageError
USAGE_ERROR: type[typer.BadParameter] = typer.BadParameter.__bases__[0]


def parse_analyses(text: str | None, quick: bool, problem: ng.GraspProblem) -> tuple[str, ...]:
    """Return the names of the analyses that ``--with`` lists.

    Without ``--with`` they are all analyses, or none with ``--quick``.

    Raises
    ------
    InputError
        On a name that is no analysis, on an analysis that the problem does not allow, and on both options.
    """
    if quick and text is not None:
        raise InputError("--quick", f"--with {text} beside it", "one of the two")
    from nlpgrasp.analysis.analyse import all_analyses, check_possible
    from nlpgrasp.optimize.options import check_analyses

    if text is None:
        return () if quick else all_analyses(problem.hand)
    names = check_analyses("--with", [name.strip() for name in text.split(",")])
    check_possible("--with", names, problem.models, problem.hand)
    return names


def add_analyses(solution: ng.GraspSolution, names: tuple[str, ...], file: Path, as_json: bool) -> ng.GraspSolution:
    """Add analyses to a solution, print each one when it is done, and save the solution.

    Parameters
    ----------
    solution : GraspSolution
        As ``file`` holds it.
    names : tuple of str
    file : Path
    as_json : bool
        Print one JSON object a line.
    """
    from nlpgrasp.analysis.analyse import analyse_one_by_one

    start_time, printed = time.monotonic(), str(solution).splitlines()
    analysed = solution
    for name, analysed in analyse_one_by_one(solution, names, solution.known_problem):
        if as_json:
            write_json_line({"event": "analysis", "name": name, "seconds": time.monotonic() - start_time})
        else:
            lines = str(analysed).splitlines()
            typer.echo("".join(f"{line}\n" for line in lines if line not in printed), nl=False)
            printed = lines
        start_time = time.monotonic()
    if names:
        analysed.save(file)
    return analysed


def program_command(
    script: Script,
    transcription: Annotated[
        str, typer.Option("--transcription", metavar="support|vertex", help="Containment: outer or inner.")
    ] = "support",
    forces: Annotated[
        bool, typer.Option("--forces/--no-forces", help="Finger forces as variables, or the support in closed form.")
    ] = True,
    spy: Annotated[
        Path | None, typer.Option("--spy", metavar="F.png", help="Picture of the Jacobian's sparsity.")
    ] = None,
) -> None:
    """Print the program (3.5-4) of a problem script as a table: variables, parameters, constraints, equations."""
    target = None if spy is None else writable(spy, script)  # before the script runs: it may change the folder
    if target is not None:
        from nlpgrasp.common.optional_packages import pyplot

        pyplot("a picture")  # before the work
    problem = load_problem(script)
    program = ng.formulate(problem, transcription, forces=forces)
    if target is not None:
        from nlpgrasp.report.pictures import write_sparsity

        write_sparsity(program, target)
    typer.echo(str(program))
    if spy is not None:
        typer.echo(f"picture written to {spy}")


def readme_problem() -> ng.GraspProblem:
    """Return the example problem of the README."""
    return ng.GraspProblem(
        body=ng.Box([0.08, 0.04, 0.04]),
        contacts=[ng.FrictionContact(0.6)] * 4,
        hand=ng.Fingertips(4, radius=0.008),
        task=ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        constraints=[ng.Table(-0.02, clearance=0.01)],
    )


def demo_command(
    out: Annotated[
        Path, typer.Option("--out", metavar="F.json", help="The grasp found; the page goes beside it.")
    ] = Path("demo.json"),
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser, where there is one.")
    ] = True,
) -> None:
    """Solve README's example in seconds, certify and verify the grasp, and open a page that shows it."""
    page = out.with_suffix(".html")
    target, _ = writable(out), writable(page, out)
    typer.echo(INTRODUCTION)

    with Reporter("demo", DEMO_STARTS, False) as reporter:
        solution = ng.solve(readme_problem(), DEMO_STARTS, progress=reporter.start_done)
    solution.save(target)
    typer.echo(str(solution))
    verification = ng.verify(target)
    typer.echo(verification.verdict)
    if solution.known_problem is not None:
        names = parse_analyses(None, False, solution.known_problem)
        solution = add_analyses(solution, names, target, False)
    from nlpgrasp.report import write_report

    write_report({out.name: solution}, page)
    typer.echo(f"\nwritten to {out} and {page}")
    if show:
        open_page(page)
    if not (solution.success and verification):
        raise typer.Exit(1)


def _root_command(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    with_module: Annotated[
        list[Path] | None,
        typer.Option(WITH_MODULE, metavar="F.py", help="Python file with kinds of your own, for any command."),
    ] = None,
) -> None:
    """Print the version if asked."""  # the application states a help text of its own
    del with_module  # loaded before commands are known
    if version:
        typer.echo(f"nlpgrasp {__version__}")
        raise typer.Exit


def solve_command(
    script: Script,
    out: Annotated[Path | None, typer.Option("--out", help="Result; SCRIPT's name with .json by default.")] = None,
    starts: Annotated[int, typer.Option("--starts", help="Number of starts.")] = 8,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the starts.")] = 0,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; one a core by default.")] = None,
    gap: Annotated[float | None, typer.Option("--gap", help="Search until this close to the best possible.")] = None,
    time_limit: Annotated[float | None, typer.Option("--time-limit", help="Seconds of wall time.")] = None,
    edge_margin: Annotated[
        float | None, typer.Option("--edge-margin", help="Metres between contacts and sharp edges; 0 for none.")
    ] = None,
    rank: Annotated[
        str, typer.Option("--rank", help="robust: pass over a fragile best start; mu: the best mu, whatever is left.")
    ] = "robust",
    keep: Annotated[int, typer.Option("--keep", help="Distinct grasps that are kept, the best ones.")] = 1,
    distinct: Annotated[
        float, typer.Option("--distinct", help="How far apart they are, as a share of the body's size.")
    ] = 0.1,
    analyses: Annotated[
        str | None,
        typer.Option("--with", metavar="A,B", help="Analyses added after the grasp, e.g. prices,nu; all by default."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="The grasp alone, without analyses.")] = False,
    proof: Annotated[
        bool, typer.Option("--proof", help="Write a proof of the bounds on mu beside the result.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Solve a problem script and write the grasp found to a file, then add analyses to it.

    Ctrl-C keeps the best so far.
    """
    integer("--starts", starts, at_least=1)
    integer("--seed", seed, at_least=0)
    integer("--keep", keep, at_least=1, at_most=10_000)
    share("--distinct", distinct)
    options = ng.SolveOptions(workers=workers, gap=gap, time_limit=time_limit, edge_margin=edge_margin, rank=rank)
    target = Path(f"{script.stem}.json") if out is None else out
    file = writable(target, script)  # before the script runs: it may change the working directory
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problem = load_problem(script)
    names = parse_analyses(analyses, quick, problem)
    with Reporter(problem.name, starts, as_json) as reporter:
        solution = ng.solve(problem, starts, seed, options, keep=keep, distinct=distinct, progress=reporter.start_done)
    written = None
    if solution.is_certified or not file.exists():
        solution.save(file)
        written = str(target)
    if not as_json:
        _print_solution(solution, f"written to {written}" if written else f"{target} left as it was")
    cut_short = solution.status in (ng.Status.TIME_LIMIT, ng.Status.INTERRUPTED)
    if solution.is_certified and not (cut_short and analyses is None):
        solution = add_analyses(solution, names, file, as_json)
    if proof and solution.is_certified:
        bounds = solution.write_proof(file.with_suffix(".proof"))
        if not as_json:
            typer.echo(f"  {bounds.kind} proved in {bounds}; written to {target.with_suffix('.proof')}")
    if as_json:
        write_json_line(final_record(solution, written))
    if not solution.success:
        raise typer.Exit(1)


def _print_solution(solution: ng.GraspSolution, note: str) -> None:
    """Print a solution with wall time, number of starts and a note."""
    count = len(solution.starts)
    typer.echo(str(solution))
    typer.echo(f"  {solution.solver['seconds']['total']:.1f} s, {count} start{'' if count == 1 else 's'}")
    typer.echo(f"  {note}")


def verify_command(
    file: File,
    rtol: Rtol = 0.01,
    folder: Folders = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when any check could not be made.")] = False,
    script: Annotated[
        Path | None, typer.Option("--script", metavar="SCRIPT", help="Problem script with the function of a TaskSet.")
    ] = None,
    proof: Annotated[
        Path | None, typer.Option("--proof", metavar="F.proof", help="Proof of the bounds on mu; found beside F.json.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a solution file or a bound file by independent code: quality, surface, constraints, hand, certificate.

    Exit code: 0 if no check fails, 1 if one fails (with --strict also if one cannot be made), 2 on bad input.
    """
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problem = None if script is None else load_problem(script)
    verification = ng.verify(file, rtol, folder or (), proof)
    del problem  # the file's task finds its function while the problem is there
    if as_json:
        checks = [asdict(check) for check in verification.checks]
        mu_pair = None if verification.mu is None else bounds_pair(verification.mu)
        summary = {"passed": verification.passed, "complete": verification.complete, "missing": verification.missing}
        write_json_line({**summary, "mu": mu_pair, "checks": checks})
    else:
        typer.echo(str(verification))
    if not verification or (strict and not verification.complete):
        raise typer.Exit(1)


def export_placeholder() -> None:  # its docstring is the help text of ``export`` in the list of commands
    """Write a solution for other tools."""


def command_line(arguments: Sequence[str]) -> typer.Typer:
    """Return the command line application.

    If ``export`` is among the arguments, its help lists the registered formats.
    """
    app = typer.Typer(
        help="Find the best grasp of a body for a task, and certify how good it is.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_root_command)
    app.command("demo")(demo_command)
    app.command("solve")(solve_command)
    app.command("bound")(bound_command)
    app.command("program")(program_command)
    app.command("verify")(verify_command)
    app.command("prove")(prove_command)
    app.command("check")(check_command)
    app.command("quality")(quality_command)
    app.command("experiment")(experiment_command)
    app.command("parts")(parts_command)
    app.command("report")(report_command)
    app.command("hand")(hand_command)
    if "export" in arguments:
        from nlpgrasp.interop.registry import formats

        app.command("export")(export_command(formats()))
    else:
        app.command("export")(export_placeholder)
    app.command("simulate")(simulate_command)
    app.add_typer(task_app(), name="task")
    app.add_typer(set_app(), name="set")
    return app


def main() -> None:
    """Run the command line and exit with code 0 if done, 1 if a result fails or is missing, 2 on bad input.

    Bad input ends with one line on standard error.
    """
    warnings.formatwarning = _format_warning
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()  # the shell may have closed them
    try:
        arguments = load_modules(sys.argv[1:])
        code = command_line(arguments)(arguments, standalone_mode=False)
    except NlpgraspError as error:
        _exit(str(error), 2)
    except USAGE_ERROR as error:
        _exit(" ".join(error.format_message().split()) + _suggest_help(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        _exit("interrupted", 1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    if code == INTERRUPTED_CODE:
        _exit("interrupted", 1)
    sys.exit(code if isinstance(code, int) else 0)


def _suggest_help(error: typer.BadParameter) -> str:
    """Return a hint at a command's help if the error is an unknown option, or an empty text."""
    option = getattr(error, "option_name", None)
    context = getattr(error, "ctx", None)
    if option is None or context is None or getattr(error, "possibilities", None):
        return ""
    commands: list[str] = []
    while context.parent is not None:
        commands.insert(0, str(context.info_name))
        context = context.parent
    return f"; `{' '.join(['nlpgrasp', *commands, '--help'])}` lists those there are"


def _format_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Format a warning as one line; replaces ``warnings.formatwarning``."""
    return f"nlpgrasp: {message}\n"


def _exit(message: str, code: int) -> NoReturn:
    """Write a message to standard error and exit with a code."""
    sys.stderr.write(f"nlpgrasp: {message}\n")
    sys.exit(code)

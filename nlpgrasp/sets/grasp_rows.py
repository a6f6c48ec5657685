"""Table rows of a set of grasps, one per start, and their Parquet files."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

from nlpgrasp.analysis.squeeze import squeeze_for_task
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.experiments.solve_record import body_digest
from nlpgrasp.interop.hand_states import HandStates
from nlpgrasp.problem.identity import data_digest
from nlpgrasp.sets.stored_solution import COLUMNS as RECORD
from nlpgrasp.sets.stored_solution import pack_solution
from nlpgrasp.simulation.hand_protocol import HoldTest
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.version import __version__

GRASP, DUPLICATE, TOUCHES, NO_GRASP, FAILED = "grasp", "duplicate", "touches", "no grasp", "failed"
STATUSES = (GRASP, DUPLICATE, TOUCHES, NO_GRASP, FAILED)
NOT_SIMULATED = "not simulated"
NOT_REQUESTED = f"{NOT_SIMULATED}: not requested"  # verdict of grasps that may be simulated later
TEXT = ("problem", "status", "reason", "object", "hand", "way_in", "verdict")
WHOLE = ("start", "seed")
REAL = ("mu_lower", "mu_upper", "mu_gap", "link_depth", "friction_needed", "slip", "turn")
COST = ("seconds", "cpu_seconds", "simulation_cpu_seconds")
POSTURES = ("pregrasp_qpos", "grasp_qpos", "squeeze_qpos", "lift_qpos")
VECTORS = ("contact_points", "contact_normals", *POSTURES, "squeeze_effort")
HAS = ("has_pose", "has_pregrasp", "has_squeeze", "has_lift", "has_depth")
FLAGS = (*HAS, "way_in_free", "simulated", "held", "caged")
SIMULATED = ("simulated", "held", "caged", "verdict", "slip", "turn")  # labels of the simulation
LABEL_RTOL = 1e-9  # difference of a label from its solution that counts as rounding, relative, in metres and radians
LABELS = (
    *("problem", "start", "seed", "object", "hand", "status", "reason", "mu_lower", "mu_upper", "mu_gap"),
    *("contact_points", "contact_normals", "faces", "has_pose", "grasp_qpos", "has_pregrasp", "pregrasp_qpos"),
    *("has_squeeze", "squeeze_qpos", "squeeze_effort", "friction_needed", "has_lift", "lift_qpos"),
    *("has_depth", "link_depth", "way_in_free", "way_in", "simulated", "held", "caged", "verdict", "slip", "turn"),
    *("seconds", "cpu_seconds", "simulation_cpu_seconds"),
)
ALWAYS_STATED = ("problem", "start", "seed", "object", "hand", "status", "reason", *COST)
"""Columns that every row states; in rows without a grasp the others are null, and flags false."""

GROUP = 64  # rows of a row group, which are read together

Row = dict[str, object]


def import_pyarrow(module: str = "pyarrow.parquet") -> ModuleType:
    """Import a module of pyarrow, by default the one for Parquet files.

    Raises
    ------
    MissingExtraError
        When it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingExtraError("a set of grasps", "tables") from None


@dataclass(frozen=True)
class RowIdentity:
    """Row entries that all starts of a problem share.

    Parameters
    ----------
    problem : str
        Name of the problem.
    seed : int
        Seed of the set.
    body, hand : str
        Digests of the body and of the hand; empty without a hand.
    """

    problem: str
    seed: int
    body: str
    hand: str

    def row_without_grasp(self, start: int, status: str, reason: str, **entries: object) -> Row:
        """Return the row of a start without a grasp."""
        row = {"problem": self.problem, "seed": self.seed, "object": self.body, "hand": self.hand, "start": start}
        row |= {"status": status, "reason": reason}
        return row | dict.fromkeys(FLAGS, False) | dict.fromkeys(COST, 0.0) | entries

    def row_with_grasp(
        self, start: int, solution: GraspSolution, hold: HoldTest | None, verdict: str, **entries: object
    ) -> Row:
        """Return the row of a start with a grasp.

        ``verdict`` is the outcome of the simulation, or the reason why there is none.
        """
        return self.labels_of(start, solution) | simulation_labels(hold, verdict) | pack_solution(solution) | entries

    def labels_of(self, start: int, solution: GraspSolution) -> Row:
        """Return the row entries of a start with a grasp that follow from its solution, beside times and simulation."""
        grasp, depth = solution.require_grasp(), solution.link_depth
        row = self.row_without_grasp(start, GRASP, "") | {
            "mu_lower": solution.mu.lower,
            "mu_upper": solution.mu.upper,
            "mu_gap": solution.mu.gap,
            "contact_points": grasp.points.ravel().tolist(),
            "contact_normals": grasp.normals.ravel().tolist(),
            "faces": list(solution.faces),
            "has_depth": depth is not None,
            "link_depth": None if depth is None else depth.depth,
        }
        return row | _posture_entries(solution)


def row_identity(name: str, seed: int, problem: Json) -> RowIdentity:
    """Return the entries shared by all rows of a problem, from the problem's JSON data."""
    body, hand = problem["body"], problem.get("hand")
    return RowIdentity(name, seed, body_digest(body) or data_digest(body), "" if hand is None else data_digest(hand))


def simulation_labels(hold: HoldTest | None, verdict: str) -> Row:
    """Return the row entries of a simulation; without one, the verdict is the reason."""
    labels: Row = {"simulated": hold is not None, "verdict": verdict}
    if hold is not None:
        labels |= {"held": hold.held, "caged": hold.caged, "slip": hold.motion.slip, "turn": hold.motion.turn}
    return labels


def differing_label(stated: Row, expected: Row) -> str | None:
    """Return the name of a label that differs from that of the row's solution, or None.

    Labels of the simulation and times are not compared: a solution does not determine them.
    """
    for name in LABELS:
        if name not in (*SIMULATED, *COST) and not _are_equal(stated[name], expected.get(name)):
            return name
    return None


def _are_equal(stated: object, expected: object) -> bool:
    """Return whether two entries are equal, numbers up to rounding."""
    if stated is None or expected is None or isinstance(expected, str | bool):
        return stated == expected
    if isinstance(expected, list) and expected and isinstance(expected[0], str):
        return stated == expected
    a, b = np.asarray(stated, dtype=float), np.asarray(expected, dtype=float)
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=LABEL_RTOL, atol=LABEL_RTOL, equal_nan=True))


def _posture_entries(solution: GraspSolution) -> Row:
    """Return the row entries on the hand of a grasp: poses, joints and approach.

    Without a hand that has a pose, the only entry is the reason.
    """
    if "palm_pose" not in (solution.hand or {}):
        return {"way_in": "no hand with a pose"}
    states = HandStates.of(solution)
    row: Row = {"grasp_qpos": states.row("grasp").tolist(), "has_pose": True, "has_pregrasp": states.has_pregrasp}
    if states.has_pregrasp:
        row["pregrasp_qpos"] = states.row("pregrasp").tolist()
    row |= {"way_in_free": not states.blocked, "way_in": states.blocked, "has_squeeze": not states.no_squeeze}
    if not states.no_squeeze:
        row |= {"squeeze_qpos": states.row("squeeze").tolist(), "squeeze_effort": states.effort_row().tolist()}
        row["friction_needed"] = (solution.squeeze or squeeze_for_task(solution)).friction_needed
    if states.has_lift:
        row |= {"has_lift": True, "lift_qpos": states.row("lift").tolist()}
    return row


def row_schema() -> Any:
    """Return the Arrow schema of a set's rows."""
    pa = import_pyarrow("pyarrow")
    kinds = dict.fromkeys(TEXT, pa.string()) | dict.fromkeys(WHOLE, pa.int64()) | dict.fromkeys(FLAGS, pa.bool_())
    kinds |= dict.fromkeys((*REAL, *COST), pa.float64()) | dict.fromkeys(VECTORS, pa.list_(pa.float64()))
    kinds |= {"faces": pa.list_(pa.string()), "outline": pa.string(), "constraint_names": pa.string()}
    kinds |= dict.fromkeys(("numbers", "constraint_values", "proof"), pa.binary())
    return pa.schema([(name, kinds[name]) for name in (*LABELS, *RECORD)])


def parquet_bytes(rows: Iterable[Row] | Any, problem: str, unit: str) -> bytes:
    """Return rows, or a table of rows, as the bytes of a Parquet file with checksums.

    Parameters
    ----------
    rows : iterable of dict, or pyarrow.Table
    problem : str
        The problem's digest.
    unit : str
        Number of the unit; ``"all"`` for all rows of a problem.
    """
    pa, pq, sink = import_pyarrow("pyarrow"), import_pyarrow(), io.BytesIO()
    table = rows if isinstance(rows, pa.Table) else pa.Table.from_pylist(list(rows), schema=row_schema())
    settings = {
        "compression": "zstd",
        "compression_level": 15,
        "use_dictionary": [*TEXT, "outline", "constraint_names", "faces.list.element"],
        "write_statistics": False,
        "store_schema": False,
        "write_page_checksum": True,
    }
    with pq.ParquetWriter(sink, table.schema, **settings) as writer:
        writer.write_table(table, row_group_size=GROUP)
        writer.add_key_value_metadata({"nlpgrasp": __version__, "problem": problem, "unit": unit})
    return sink.getvalue()


def read_rows(source: object, columns: Sequence[str], problem: str, field: str, group: int | None = None) -> Any:
    """Read columns of a Parquet file, given by path or content, as an Arrow table.

    Parameters
    ----------
    source : path or bytes
    columns : sequence of str
    problem : str
        Digest of the problem to which the rows have to belong.
    field : str
        Name of the file in messages.
    group : int, optional
        Number of a row group to read: rows from ``GROUP * group`` on, at most ``GROUP``; all rows by default.

    Raises
    ------
    InputError
        On a damaged file, and on rows of another problem.
    """
    pa, pq = import_pyarrow("pyarrow"), import_pyarrow()
    opened = pa.BufferReader(source) if isinstance(source, bytes) else source
    try:
        with pq.ParquetFile(opened, page_checksum_verification=True) as file:
            stated = {k.decode(): v.decode() for k, v in (file.metadata.metadata or {}).items()}
            table = file.read(list(columns)) if group is None else file.read_row_group(group, list(columns))
            table = table.select(list(columns))
    except (pa.ArrowException, OSError, UnicodeDecodeError, KeyError) as error:  # the last: a column is missing
        raise InputError(field, f"a damaged file ({str(error).splitlines()[0][:60]})", "rows of this set") from None
    if stated.get("problem") != problem:
        raise InputError(field, "rows of another problem", f"rows of the problem with digest {problem}")
    return table

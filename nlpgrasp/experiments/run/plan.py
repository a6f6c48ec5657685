"""Plan of an output folder: the experiment as JSON data, compared before a resume."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import NotRequired, TypedDict

from nlpgrasp.common.files import as_read
from nlpgrasp.common.shown.text import one_line, plain
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import Experiment, check_names, check_seeds
from nlpgrasp.experiments.ask.variation import CaseData
from nlpgrasp.experiments.found.digest import without_recorded
from nlpgrasp.solution.file import DEEPEST, depth
from nlpgrasp.version import __version__

PLAN_SCHEMA = "nlpgrasp-experiment/1"


class Plan(TypedDict):
    """JSON data of an experiment."""

    schema: str
    created_by: NotRequired[dict[str, str]]
    name: str
    seeds: list[int]
    variations: dict[str, CaseData]


def plan_of(experiment: Experiment) -> Plan:
    """Return the experiment as JSON data: everything that determines its results, and the version."""
    variations = {
        name: {"deferred": True} if experiment.deferred(name) else experiment.case(name).to_dict()
        for name in experiment.names
    }
    plan = {
        "schema": PLAN_SCHEMA,
        "created_by": {"nlpgrasp": __version__},
        "name": experiment.name,
        "seeds": list(experiment.seeds),
        "variations": variations,
    }
    read: Plan = as_read(plan)
    return read


def read_plan(text: str, where: str) -> Plan:
    """Return the plan of a JSON text.

    Raises
    ------
    InputError
        When it is not the plan of an experiment.
    """
    allowed = f"the plan of an experiment ({PLAN_SCHEMA})"
    if depth(text) > DEEPEST:
        raise InputError(where, f"nesting deeper than {DEEPEST}", allowed)
    try:
        plan: Plan = json.loads(text)
        if plan["schema"] != PLAN_SCHEMA or not isinstance(plan["variations"], dict):
            raise ValueError("another schema")
        check_names(list(plan["variations"]))
        check_seeds(plan["seeds"])
        if not all(isinstance(v, dict) and isinstance(v.get("problem", {}), dict) for v in plan["variations"].values()):
            raise ValueError("variations that are none")
        plan["name"] = plain(str(plan.get("name", "")))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(where, f"no plan ({one_line(error)})", allowed) from None
    return plan


def check_same(old: Plan, new: Plan, where: str) -> None:
    """Refuse to resume another experiment; variations and seeds may be added.

    Raises
    ------
    InputError
        Naming the differences.
    """
    theirs, ours = ({name: _lean(case) for name, case in plan["variations"].items()} for plan in (old, new))
    gone = [name for name in theirs if name not in ours]
    changed = [name for name in theirs if name in ours and theirs[name] != ours[name]]
    seeds = [seed for seed in old["seeds"] if seed not in new["seeds"]]
    difference = None
    if old.get("name") != new["name"]:
        difference = f"the experiment {old.get('name')!r}"
    elif gone:
        difference = f"an experiment with a variation {gone[0]!r}"
    elif changed:
        one, other = theirs[changed[0]], ours[changed[0]]
        parts = _differing(one, other) + _differing(one.get("problem", {}), other.get("problem", {}))
        difference = f"an experiment whose variation {changed[0]!r} is another ({', '.join(parts)})"
    elif seeds:
        difference = f"an experiment with seed {seeds[0]}"
    if difference is not None:
        raise InputError(f"out ({where})", difference, "the folder of this experiment, or a new one")


def _lean(case: CaseData) -> CaseData:
    """Return a variation without the entries that older plans lack."""
    lean: CaseData = {**case}
    if "problem" in case:
        lean["problem"] = without_recorded(case["problem"])
    return lean


def _differing(one: Mapping[str, object], other: Mapping[str, object]) -> list[str]:
    """Return the keys of the second mapping with different values."""
    return [key for key, value in other.items() if one.get(key) != value]

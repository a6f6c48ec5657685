"""Check of registered kinds in a file: contacts, tasks and force budgets."""

from __future__ import annotations

from nlpgrasp.budgets.registry import BUDGETS, NAMED
from nlpgrasp.common.types import Json
from nlpgrasp.contacts.base import CONTACTS
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import TASKS

EXPECTED = "what schema 1 says (docs/json.md)"


def check_kinds(data: Json, name: str) -> None:
    """Refuse schema-valid data with contacts, a task or a budget of an unregistered kind.

    Parameters
    ----------
    data : dict
        Data of the whole file.
    name : str
        Name of the file, for messages.
    """
    kept = {f"grasps.{i}.grasp": found["grasp"] for i, found in enumerate(data.get("grasps", ()))}
    for place, grasp in {"grasp": data["grasp"], **kept}.items():
        for i, contact in enumerate([] if grasp is None else grasp["contacts"]):
            if CONTACTS.find(contact["model"]) is None:
                given = f"{contact['model']!r} is not one of {[*CONTACTS.names]}"
                raise InputError(f"{name}: {place}.contacts.{i}.model", given, EXPECTED)
    task = data["problem"]["task"]
    if not _known_task(task):
        raise InputError(f"{name}: problem.task", _misfit(task), EXPECTED)
    budget = data["problem"]["force_budget"]
    if not (budget in NAMED if isinstance(budget, str) else BUDGETS.find(budget["type"])):
        raise InputError(f"{name}: problem.force_budget", _misfit(budget), EXPECTED)


def _known_task(task: Json) -> bool:
    """Return whether a task and all its parts are of known kinds."""
    parts = task["tasks"] if task["type"] == "sum" else ()
    return TASKS.find(task["type"]) is not None and all(_known_task(part) for part in parts)


def _misfit(given: object) -> str:
    return f"{given!r} is not valid under any of the given schemas"

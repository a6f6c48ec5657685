"""Edits of solution files that make their statements false."""

import numpy as np

import nlpgrasp as ng
from tests.verify.stated import edited, recomputed_file


def put(path, value):
    """Return an edit of one entry; a function of the old value where that is given."""

    def change(data):
        *keys, last = path
        for key in keys:
            data = data[key]
        data[last] = value(data[last]) if callable(value) else value

    return change


def unbounded(data):
    """Remove the bound over all placements, which a file with another quality would contradict when it is read."""
    data["quality"].pop("best_possible", None)


def row(name, key, value):
    """Return an edit of a stated constraint."""

    def change(data):
        stated = next(r for r in data["constraints"] if r["name"] == name)
        stated[key] = value(stated[key]) if callable(value) else value

    return change


def drop(name):
    """Return an edit that removes a stated constraint."""

    def change(data):
        others = [r for r in data["constraints"] if r["name"] != name]
        assert len(others) == len(data["constraints"]) - 1
        data["constraints"] = others

    return change


def repeat(name, other):
    """Return an edit that states a constraint once more, under another name."""

    def change(data):
        data["constraints"].append({**next(r for r in data["constraints"] if r["name"] == name), "name": other})

    return change


def turned(i, normal):
    """Return an edit of a normal, with tangents perpendicular to it."""

    def change(data):
        frame = np.linalg.qr(np.column_stack([normal, np.eye(3)[np.argsort(np.abs(normal))[:2]].T]))[0].T
        entry = data["grasp"]["contacts"][i]
        entry["normal"] = list(normal)
        entry["tangents"] = [frame[1].tolist(), np.cross(normal, frame[1]).tolist()]

    return change


def asked(i, *path):
    return ("problem", "constraints", i, *path)


def contact(i, key):
    return ("grasp", "contacts", i, key)


def a_little(v):
    return v + 1e-4


def together(*changes):
    """Return several edits as one."""

    def change(data):
        for edit in changes:
            edit(data)

    return change


def verified(data, change):
    """Return the verification of a file after a change."""
    return ng.verify(ng.GraspSolution.from_dict(edited(data, change), "f.json"), rtol=0.05)


def failed(verification):
    return [check.name for check in verification.checks if not check.passed]


def failures(data, *folders):
    return [name for name, check in recomputed_file(data, *folders).items() if check.failed]

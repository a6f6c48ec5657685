"""Rejection of pulling forces, for every contact model."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from nlpgrasp.verify.force_checks import force_checks
from tests.samples import EVERY as CONTACTS
from tests.verify.stated import stated_file

POINTS, NORMALS = [[0.3, 0.0, 0.0], [-0.3, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
MODELS = [name for name, contact in CONTACTS.items() if contact.unilateral and not name.endswith("line")]


def said(name, forces):
    """Return the check of forces along the line between two opposed contacts."""
    contact = CONTACTS[name]
    if isinstance(contact, ng.PlaneContact) and contact.extents:
        contact = replace(contact, direction=(0.0, 1.0, 0.0))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    problem = ng.GraspProblem(ng.Box([0.6, 0.4, 0.4]), [contact] * 2, task)
    solution = ng.GraspSolution.from_dict(stated_file(problem, ["+x", "-x"], POINTS, NORMALS), "file.json")
    along = np.array([[f, 0.0, 0.0] for f in forces])
    wrench = np.append(along.sum(axis=0), [0.0, 0.0, 0.0])
    stated = replace(solution, forces=((wrench, along),))
    return force_checks(stated, stated.grasp, WrenchSet.of(stated.grasp).force_set)[0]


@pytest.mark.parametrize("name", MODELS)
def test_pushing_passes_and_pulling_does_not(name):
    assert said(name, [0.0, 0.5]).passed
    assert said(name, [-0.3, 0.5]).passed
    pulling = said(name, [0.5, 0.0])
    assert pulling.failed
    assert "distance to the cones 1.0e+00" in pulling.detail
    assert said(name, [0.25, 0.25]).failed

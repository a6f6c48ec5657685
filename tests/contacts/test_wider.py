"""Inclusion of contact models, against sampled cone points."""

import itertools

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.contacts.cone_inclusion import assign_contacts, contains
from tests.quick import every_row

MODELS = {
    "point": ng.PointContact(),
    "slippery": ng.FrictionContact(0.3),
    "rough": ng.FrictionContact(0.5),
    "soft": ng.SoftContact(0.5, 0.01),
    "softer": ng.SoftContact(0.5, 0.02),
    "elliptic": ng.SoftContact(0.5, 0.01, "elliptic"),
    "wide elliptic": ng.SoftContact(0.8, 0.02, "elliptic"),
    "line": ng.LineContact(0.02, friction=0.5, direction=[1.0, 0.2, 0.3]),
    "short line": ng.LineContact(0.01, friction=0.5, direction=[1.0, 0.2, 0.3]),
    "line box": ng.LineContact(0.02, friction=0.5, direction=[1.0, 0.2, 0.3], model="box"),
    "smooth line": ng.LineContact(0.02, direction=[1.0, 0.2, 0.3]),
    "corners": ng.PlaneContact(extents=[0.02, 0.01], friction=0.6, direction=[1.0, 0.2, 0.3]),
    "other line": ng.LineContact(0.02, friction=0.5, direction=[0.2, 1.0, 0.3]),
    "disc": ng.PlaneContact(radius=0.01, friction=0.5),
    "rectangle": ng.PlaneContact(extents=[0.02, 0.01], friction=0.6, direction=[1.0, 0.2, 0.3], model="box"),
    "smooth disc": ng.PlaneContact(radius=0.01),
}
PAIRS = list(itertools.permutations(MODELS, 2))


def wrenches(model, normal, rng):
    """Return random extreme wrenches of unit normal force, body frame, (m, 6)."""
    z = rng.standard_normal((4000, model.components(3))) * np.exp(rng.uniform(-6.0, 6.0, (4000, model.components(3))))
    z[:, 0] = 0.0
    forces = model.extreme(z)[1]
    frame = np.vstack([normal, model.tangents(normal[None])[0]]).T
    local = forces @ model.basis(3).T
    return np.concatenate([local[:, :3] @ frame.T, local[:, 3:] @ frame.T], axis=1)


def can_exert(model, normal, body_wrenches):
    """Return whether each wrench is in the contact's cone, by its own projection."""
    frame = np.vstack([normal, model.tangents(normal[None])[0]]).T
    local = np.concatenate([body_wrenches[:, :3] @ frame, body_wrenches[:, 3:] @ frame], axis=1)
    basis = model.basis(3)
    x = local @ basis
    is_spanned = np.abs(x @ basis.T - local).max(axis=1) <= 1e-12
    return is_spanned & (np.linalg.norm(model.project(x) - x, axis=1) <= 1e-9)


@pytest.mark.parametrize(("wide", "narrow"), every_row(4, PAIRS), ids=[f"{b} in {a}" for a, b in PAIRS])
def test_a_wider_contact_can_exert_every_wrench_of_the_other(wide, narrow):
    normal, rng = np.array([0.6, 0.0, 0.8]), np.random.default_rng(0)
    samples = wrenches(MODELS[narrow], normal, rng)
    result = contains(MODELS[wide], MODELS[narrow], 3)
    assert result == bool(can_exert(MODELS[wide], normal, samples).all())
    assert not result or can_exert(MODELS[wide], normal, samples).all()


def test_in_the_plane_and_of_contacts_that_pull():
    assert contains(ng.LineContact(0.1, friction=0.5), ng.FrictionContact(0.5), 2)
    assert not contains(ng.FrictionContact(0.5), ng.LineContact(0.1, friction=0.5), 2)
    glue = ng.BilateralContact(ng.FrictionContact(0.5))
    assert contains(glue, glue, 3)
    assert not contains(ng.SoftContact(0.5, 0.1), glue, 3)


def test_each_contact_gets_a_wider_one_of_its_own():
    point, hard, soft = (MODELS[name] for name in ("point", "rough", "soft"))
    assert assign_contacts([hard, point], [hard, soft, point], 3) == [0, 1]
    assert assign_contacts([hard, soft], [hard, point, soft], 3) == [0, 2]
    assert assign_contacts([soft, hard], [hard, soft, soft], 3) == [2, 1]
    assert assign_contacts([soft, soft], [hard, soft, hard], 3) is None
    assert assign_contacts([hard, hard], [hard], 3) is None
    assert assign_contacts([hard, soft], [soft, hard], 3, groups=[0, 1]) is None
    assert assign_contacts([ng.FrictionContact(0.5, faces="+x")], [ng.FrictionContact(0.5, faces=["+x", "-x"])], 3) == [
        0
    ]
    assert assign_contacts([ng.FrictionContact(0.5)], [ng.FrictionContact(0.5, faces="+x")], 3) is None

"""Contact models with scaled friction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import nlpgrasp as ng
from nlpgrasp.common.validation import replace_unchecked
from tests.samples import EVERY as CONTACTS

models = pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())
rough = pytest.mark.parametrize(
    "contact", [c for c in CONTACTS.values() if c.coefficients], ids=[n for n, c in CONTACTS.items() if c.coefficients]
)


@models
@given(factor=st.floats(0.01, 100.0))
def test_every_coefficient_is_scaled_and_nothing_else(contact, factor):
    scaled = contact.with_friction(factor)
    assert scaled.coefficients == {name: factor * value for name, value in contact.coefficients.items()}
    others = {n: v for n, v in contact.to_dict().items() if n not in contact.coefficients}
    assert {n: v for n, v in scaled.to_dict().items() if n not in contact.coefficients} == others
    assert scaled.faces == contact.faces


@models
def test_the_same_friction_is_the_same_contact(contact):
    assert contact.with_friction(1.0) == contact


@pytest.mark.parametrize("name", ["point", "line", "disc", "bilateral"])
def test_without_friction_the_contact_itself(name):
    assert CONTACTS[name].with_friction(0.5) is CONTACTS[name]


@rough
def test_less_friction_never_does_more_work(contact, rng):
    z = rng.standard_normal((500, contact.components(3)))
    reduced, unchanged, increased = (contact.with_friction(f).extreme(z)[0] for f in (0.8, 1.0, 1.25))
    assert np.all(reduced <= unchanged)
    assert np.all(unchanged <= increased)
    assert np.any(reduced < unchanged)


@rough
def test_without_any_friction_left_it_is_refused(contact):
    with pytest.raises(ng.InputError, match=r"friction: got 0\.0"):
        contact.with_friction(0.0)


def test_one_coefficient_alone():
    soft = ng.SoftContact(0.5, 0.01, faces="top")
    assert soft.with_coefficients(friction=0.7) == ng.SoftContact(0.7, 0.01, faces="top")


def test_an_unchecked_copy_steps_over_a_limit():
    table = ng.Table(0.1, clearance=0.0)
    below = replace_unchecked(table, clearance=-1e-6)
    assert (below.height, below.clearance, table.clearance) == (0.1, -1e-6, 0.0)

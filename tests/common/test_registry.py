"""Registries of classes by name."""

import pytest

from nlpgrasp.common.registry import Registry
from nlpgrasp.errors import InputError


class One:
    """A kind."""


class Two:
    """Another."""


@pytest.fixture
def registry():
    result = Registry("thing.kind")
    result.add("one", One)
    result.add("two", Two)
    return result


def test_kinds_are_found_by_name_in_the_order_they_came(registry):
    assert registry.names == ("one", "two")
    assert registry.find("one") is One
    assert registry.find("three") is None
    assert registry.find(["one"]) is None


def test_the_same_class_may_come_again_but_a_name_has_one_class(registry):
    registry.add("one", One)
    assert registry.names == ("one", "two")
    with pytest.raises(InputError, match=r"Two\.kind: got one, expected another name: that one is One's"):
        registry.add("one", Two)
    assert registry.find("one") is One


@pytest.mark.parametrize("name", ["", None, 3])
def test_a_kind_needs_a_name(registry, name):
    with pytest.raises(InputError, match=r"One\.kind.*expected the name that stands for it in a file"):
        registry.add(name, One)


def test_unknown_names_are_answered_with_those_that_are_known(registry):
    assert str(registry.unknown("three")) == "thing.kind: got three, expected one of one, two"

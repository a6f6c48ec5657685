"""The docstrings of the public names: they begin with a sentence, arrays have shapes, and what comes back is said."""

import inspect
import re

import nlpgrasp as ng

FEWEST_WORDS = 4
SIZES = {"count", "dimension", "space", "steps"}  # in shapes, beside numbers and names of up to three characters
GROUP = re.compile(r"(?<!\w)\(((?:[^()]|\([^()]*\))*)\)")
ENTRY = re.compile(r"^(?!\s)[\w, *]+? : (.*\barrays?\b.*)$", re.MULTILINE)
RETURNS = re.compile(r"^Returns\n-+\n(.*?)(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)


def function_of(raw):
    """The function behind a method, a property or a cached property; what it was where there is none."""
    for name in ("__func__", "fget", "func"):
        raw = getattr(raw, name, None) or raw
    return raw


def documented():
    """Every public name, and the public methods and properties of its class."""
    for name in ng.__all__:
        thing = getattr(ng, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            yield name, thing
        if inspect.isclass(thing):
            for owner in reversed([c for c in thing.__mro__ if c.__module__.startswith("nlpgrasp")]):
                for member, raw in vars(owner).items():
                    if not member.startswith("_") and inspect.isfunction(function_of(raw)):
                        yield f"{name}.{member}", function_of(raw)


PUBLIC = dict(documented())
TEXTS = {name: inspect.cleandoc(what.__doc__ or "") for name, what in PUBLIC.items()}


def has_shape(text):
    """Whether a text states the shape of an array: ``(k, 3)``, ``(m,)``, ``(..., n_i)``."""
    groups = [group for group in GROUP.findall(text) if "," in group]
    words = [[word for word in re.findall(r"[A-Za-z_]+", group) if len(word) > 3] for group in groups]
    return any(SIZES.issuperset(long) for long in words)


def test_the_public_names_are_found():
    assert {"solve", "Grasp", "Grasp.G", "Box.bounds", "Box.space", "URDFHand.load", "ferrari_canny"} <= PUBLIC.keys()


def test_each_begins_with_a_sentence():
    first = {name: text.split("\n\n")[0] for name, text in TEXTS.items()}
    assert {n: t for n, t in first.items() if len(t.split()) < FEWEST_WORDS or t[-1] not in ".:"} == {}


def test_arrays_have_shapes():
    entries = [(name, entry) for name, text in TEXTS.items() for entry in ENTRY.findall(text)]
    assert [pair for pair in entries if not has_shape(pair[1])] == []
    returned = {n: str(getattr(what, "__annotations__", {}).get("return", "")) for n, what in PUBLIC.items()}
    arrays = [n for n, kind in returned.items() if "FloatArray" in kind or "NDArray" in kind]
    assert "Grasp.G" in arrays
    assert {n: TEXTS[n] for n in arrays if not has_shape(TEXTS[n])} == {}


def test_what_comes_back_is_said():
    sections = {name: found[1] for name, text in TEXTS.items() if (found := RETURNS.search(text))}
    assert "solve" in sections
    assert {name: text for name, text in sections.items() if "\n    " not in text} == {}


def test_a_text_without_a_shape_is_told_from_one_with():
    assert has_shape("points (m, 3)")
    assert has_shape("of the upper triangle, (n_i (n_i + 1) / 2, ...)")
    assert not has_shape("Positions (metres, body frame) of f(x).")

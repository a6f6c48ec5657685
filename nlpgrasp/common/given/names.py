"""Suggestions for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

MOST, NEAREST = 12, 4  # most names listed in a message, most suggestions
CLOSE, LONG = 0.6, 3  # least similarity ratio of similar names; least letters of a significant word


def near(name: str, names: Iterable[str]) -> list[str]:
    """Return names similar to an unknown one, most similar first, ignoring case.

    Parameters
    ----------
    name : str
        The unknown name.
        names : iterable of str
        Known names.
    """
    by_case = {one.casefold(): one for one in names}
    close = [by_case[one] for one in get_close_matches(name.casefold(), by_case, NEAREST, CLOSE)]
    words = [word for word in name.casefold().replace("_", " ").split() if len(word) >= LONG]
    shared = [own for one, own in by_case.items() if own not in close and any(word in one for word in words)]
    return [*close, *shared][:NEAREST]


def listed(given: Iterable[object], names: Iterable[str]) -> str:
    """Return a list of at most a dozen known names as text, with suggestions for unknown ones.

    Parameters
    ----------
    given : iterable
        Unknown names.
    names : iterable of str
        Known names.
    """
    known = list(names)
    more = f" and {len(known) - MOST} more" if len(known) > MOST else ""
    meant = dict.fromkeys(nearest[0] for one in given if (nearest := near(str(one), known)))
    question = f"; did you mean {' and '.join(meant)}?" if meant else ""
    return f"{', '.join(known[:MOST])}{more}{question}"

"""Names that are not there, and those that were probably meant."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

MOST, NEAREST = 12, 4  # names that a message lists, and of near ones
CLOSE, LONG = 0.6, 3  # ratio of letters that names share where they are near; letters of a word that says something


def near(name: str, names: Iterable[str]) -> list[str]:
    """Return the names that are like one that is not there, the nearest first, whatever their case.

    Parameters
    ----------
    name : str
        What was given.
    names : iterable of str
        Those that there are.
    """
    by_case = {one.casefold(): one for one in names}
    close = [by_case[one] for one in get_close_matches(name.casefold(), by_case, NEAREST, CLOSE)]
    words = [word for word in name.casefold().replace("_", " ").split() if len(word) >= LONG]
    shared = [own for one, own in by_case.items() if own not in close and any(word in one for word in words)]
    return [*close, *shared][:NEAREST]


def listed(given: Iterable[object], names: Iterable[str]) -> str:
    """Return names after each other, a dozen at most, and which of them were probably meant.

    Parameters
    ----------
    given : iterable
        What was given in place of some of the names.
    names : iterable of str
        All that there are.
    """
    known = list(names)
    more = f" and {len(known) - MOST} more" if len(known) > MOST else ""
    meant = dict.fromkeys(nearest[0] for one in given if (nearest := near(str(one), known)))
    question = f"; did you mean {' and '.join(meant)}?" if meant else ""
    return f"{', '.join(known[:MOST])}{more}{question}"

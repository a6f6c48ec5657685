"""Constraints given by a script's expression: the file contains their name and limits alone."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count, takewhile

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.placement import StatedPlacement
from nlpgrasp.verify.rows import RowValue


def expression(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the stated limits with unknown values.

    Several limits fix the number of scalar constraints; one limit holds for all, whose number is not in the file.
    """
    name, lower, upper = str(data["name"]), list(data["lower"]), list(data["upper"])
    elements = max(len(lower), len(upper))
    numbered = list(takewhile(placement.stated.__contains__, (f"{name}[{i}]" for i in count())))
    if elements > 1:
        labels = [f"{name}[{i}]" for i in range(elements)]
    elif numbered and name in placement.stated:
        raise NotMadeError(f"the file does not say which rows are those of which {name!r}")
    else:
        labels = numbered or [name] * (name in placement.stated)
    for i, label in enumerate(labels):
        low, high = (ends[i] if len(ends) > 1 else ends[0] for ends in (lower, upper))
        yield RowValue(label, None, -np.inf if low is None else float(low), np.inf if high is None else float(high))
    if not labels:
        raise NotMadeError(f"the file states no row of {name!r}")
    text = f"the expression {name!r} stays in the script that made it; its limits are the problem's"
    raise NotMadeError(text, every_row=True)

"""Check of the stated joint-limit margins, and of the mu traded for them.

Joint ranges come from the hand's file, by this package's own kinematics. That no posture has larger margins at the
same price is not checked.
"""

from __future__ import annotations

from collections.abc import Iterator

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotMadeError
from nlpgrasp.verify.hands.urdf import require_links
from nlpgrasp.verify.placement import HandNumbers

SAME = 1e-9  # relative tolerance
PART = 0.1  # largest margin, as a share of a joint's range
LESS = 1e-6  # relative tolerance of a margin
TOLD = 1e-6  # tolerance of a stated distance, relative to the margin


def room_checks(solution: GraspSolution, hand: HandNumbers | None) -> list[Check]:
    """Check the price and the joints near a limit that ``hand.room`` states."""
    stated = (solution.hand or {}).get("room")
    if stated is None:
        return []
    wrong = "; ".join(_price(stated, solution))
    told = f"{stated['cost']:.2%} of mu, " if "cost" in stated else ""
    checks = [Check("price of room", not wrong, wrong or f"{told}{stated['price']:.2%} allowed")]
    try:
        wrong = "; ".join(_near(stated, solution, hand))
    except NotMadeError as reason:
        return [*checks, Check.not_made("room of joints", str(reason))]
    told = f"{len(stated['margins'])} joints, {len(stated['near'])} near a limit"
    return [*checks, Check("room of joints", not wrong, wrong or told)]


def _price(stated: Json, solution: GraspSolution) -> Iterator[str]:
    """Yield the errors in the price: other options than the solve's.

    In files of earlier versions, which state the cost: another cost, or more than the price allows.
    """
    price, margin = number("hand.room.price", stated["price"], at_least=0.0), stated["margin"]
    options, without = solution.solver.get("options", {}), stated.get("mu_without")
    for name, value in (("room_price", price), ("joint_margin", margin)):
        if options.get(name, value) != value:
            yield f"{name} {options[name]} among the options, {value} stated"
    if without is None:
        return
    low, high = (number(f"hand.room.mu_without.{end}", without[end], above=0.0) for end in ("lower", "upper"))
    best = solution.winner
    if best is None:
        return
    if not (best.mu.lower >= (1.0 - price - SAME) * low and best.mu.upper >= (1.0 - price - SAME) * high):
        yield f"mu in {best.mu} is more than {price:.2%} below [{low:.4f}, {high:.4f}], which is without room"
    if not abs(stated["cost"] - (1.0 - best.mu.upper / high)) <= SAME:
        yield f"it took {1.0 - best.mu.upper / high:.2%} of mu, stated {stated['cost']:.2%}"


def _near(stated: Json, solution: GraspSolution, hand: HandNumbers | None) -> Iterator[str]:
    """Yield joints with other margins, or other distances from their limits, than stated."""
    margins, near, margin = stated["margins"], stated["near"], number("hand.room.margin", stated["margin"], above=0.0)
    ends, positions = require_links(hand, "joints").ranges, (solution.hand or {})["joint_positions"]
    if set(margins) != set(ends) or not set(near) <= set(ends):
        raise InputError("hand.room.margins", ", ".join(margins), ", ".join(ends))
    for joint, (lower, upper, slides) in ends.items():
        wanted = PART * (upper - lower) if slides else min(margin, PART * (upper - lower))
        left = min(positions[joint] - lower, upper - positions[joint])
        if not abs(margins[joint] - wanted) <= TOLD * wanted:
            yield f"joint {joint} is to have {wanted:.4g}, stated {margins[joint]:.4g}"
        if joint in near and not abs(near[joint] - left) <= TOLD * wanted:
            yield f"joint {joint} is {left:.4g} from a limit, stated {near[joint]:.4g}"
        if joint not in near and not left >= (1.0 - 2.0 * LESS) * wanted:
            yield f"joint {joint} is {left:.4g} from a limit, and not named"
        if joint in near and not left <= wanted:
            yield f"joint {joint} is named and has its margin"

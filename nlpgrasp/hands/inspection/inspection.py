"""A hand looked through: what it consists of, which fingertips meet, what is to be known, and that in a few lines."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.inspection.findings import Finding, findings
from nlpgrasp.hands.inspection.inspected import Inspected, inspected
from nlpgrasp.hands.inspection.opposition import Opposition, opposition

GOOD = "All links that are to be seen have collision shapes, all joints have limits, every two fingertips can touch."
LISTED = 12  # leaf links that are named


@dataclass(frozen=True)
class Inspection:
    """What was found.

    Parameters
    ----------
    hand : Inspected
    met : Opposition or None
        Which fingertips come together; None where none are stated.
    findings : tuple of Finding
        What is to be known, grave things first.
    """

    hand: Inspected
    met: Opposition | None
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> str:
        """Whether there is something to know, in a word or two."""
        if not self.hand.tree.tips:
            return "no fingertips stated"
        count = len(self.findings)
        return f"{_counted(count, 'thing')} to know" if count else "nothing to remark on"

    @property
    def kind(self) -> str:
        """``good``, ``some`` (something to know) or ``bad`` (grasps may come out wrong for it)."""
        if not self.hand.tree.tips:
            return "some"
        if any(finding.grave for finding in self.findings):
            return "bad"
        return "some" if self.findings else "good"

    @property
    def sentences(self) -> tuple[Finding, ...]:
        """The findings, after what to do where no fingertips are stated; empty where there is nothing to remark on."""
        if self.hand.tree.tips:
            return self.findings
        some, more = self.hand.leaves[:LISTED], len(self.hand.leaves) - LISTED
        leaves = ", ".join(some) + (f" and {more} more" if more > 0 else "")
        text = "No fingertips are stated: fingertips={link: radius} or --fingertip LINK=RADIUS states them."
        return (Finding(f"{text} Links at the ends: {leaves}."), *self.findings)

    @property
    def lines(self) -> tuple[str, ...]:
        """What the hand consists of and the verdict, a line each, then the findings."""
        robot = self.hand.tree.robot
        follow = sum(joint.moves for joint in robot.joints) - len(robot.free_joints)
        joints = _counted(len(robot.free_joints), "joint") + f" and {follow} more that follow{'s' * (follow == 1)}" * (
            follow > 0
        )
        parts = f"{_counted(len(robot.links), 'link')}, {joints}, {_counted(len(self.hand.tree.tips), 'fingertip')}"
        told = [f"  {'! ' if finding.grave else '- '}{finding.text}" for finding in self.sentences]
        verdict = [f"{self.verdict}:"] if self.hand.tree.tips else []  # else the first sentence says so
        return (f"{robot.name}: {parts}", *verdict, *(told or [f"  {GOOD}"]))


def inspect(hand: Hand | Inspected) -> Inspection:
    """Look a hand through.

    Raises
    ------
    InputError
        For a hand without links.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the findings say what they say
        shown = hand if isinstance(hand, Inspected) else inspected(hand)
    met = opposition(shown.tree, shown.at_rest) if shown.tree.tips else None
    return Inspection(shown, met, findings(shown, met))


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"

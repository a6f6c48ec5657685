"""Inspection report of a hand: its parts, fingertip opposition and warnings."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.inspection.findings import OFF, Finding, findings, millimetres
from nlpgrasp.hands.inspection.inspected import Inspected, inspected
from nlpgrasp.hands.inspection.opposition import Opposition, opposition
from nlpgrasp.hands.inspection.stating import LISTED, ends_of, lines_to_paste
from nlpgrasp.hands.robot.ends import GUESS
from nlpgrasp.hands.tips import SphereTip
from nlpgrasp.hands.tips.of_shape import overhang

GOOD = "every visible link has a collision shape, every joint has limits, and every two fingertips can touch."


@dataclass(frozen=True)
class Inspection:
    """Result of inspecting a hand.

    Parameters
    ----------
    hand : Inspected
    met : Opposition or None
        Opposition of the fingertips; None where none are stated.
    findings : tuple of Finding
        Warnings, grave ones first.
    """

    hand: Inspected
    met: Opposition | None
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> str:
        """The number of warnings as text, or that there are none."""
        if not self.hand.tree.tips:
            return "no fingertips stated"
        count = len(self.findings)
        return f"{_counted(count, 'thing')} to know" if count else "no problems found"

    @property
    def kind(self) -> str:
        """``good``, ``some`` (there are warnings) or ``bad`` (grasps may come out wrong)."""
        if not self.hand.tree.tips:
            return "some"
        if any(finding.grave for finding in self.findings):
            return "bad"
        return "some" if self.findings else "good"

    @property
    def sentences(self) -> tuple[Finding, ...]:
        """The warnings, after how to state fingertips where there are none; empty without problems."""
        if self.hand.tree.tips:
            return self.findings
        ends, more = ends_of(self.hand), len(self.hand.leaves) - LISTED
        named = ", ".join(tip.link for tip in ends) + (f" and {more} more" if more > 0 else "")
        guess = ""
        if any(tip.guessed for tip in ends):
            guess = f" A radius of {GUESS:g} m stands for a link without a collision shape."
            robot = self.hand.tree.robot
            reaches = {t.link: overhang(SphereTip(GUESS), t.link, robot) or 0.0 for t in ends if t.guessed}
            off = {link: reach for link, reach in reaches.items() if reach > OFF}
            if off:
                told = ", ".join(f"{link} by up to {millimetres(reach)}" for link, reach in off.items())
                guess += f" It floats beyond the finger's own shapes at {told}: state tips that lie on the finger."
        return (Finding(f"No fingertips are stated. Links at the ends: {named}.{guess} To use them:"), *self.findings)

    @property
    def to_paste(self) -> tuple[str, ...]:
        """A command and a line of Python that state fingertips, if there are none yet; else empty."""
        return () if self.hand.tree.tips else lines_to_paste(self.hand)

    @property
    def lines(self) -> tuple[str, ...]:
        """The hand's parts and the verdict, a line each, then the warnings."""
        robot = self.hand.tree.robot
        follow = sum(joint.moves for joint in robot.joints) - len(robot.free_joints)
        joints = _counted(len(robot.free_joints), "joint") + f" and {follow} more that follow{'s' * (follow == 1)}" * (
            follow > 0
        )
        parts = f"{_counted(len(robot.links), 'link')}, {joints}, {_counted(len(self.hand.tree.tips), 'fingertip')}"
        first = f"{robot.name}: {parts}"
        told = [f"  {'! ' if f.grave else '- '}{f.command or f.text}" for f in self.sentences]
        if not self.hand.tree.tips:  # the first sentence says what to do
            return (first, told[0], *(f"      {line}" for line in self.to_paste), *told[1:])
        return (first, f"{self.verdict}:{'' if told else f' {GOOD}'}", *told)


def inspect(hand: Hand | Inspected) -> Inspection:
    """Return the inspection of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the findings hold the same warnings
        shown = hand if isinstance(hand, Inspected) else inspected(hand)
    met = opposition(shown.tree, shown.at_rest) if shown.tree.tips else None
    return Inspection(shown, met, findings(shown, met))


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"

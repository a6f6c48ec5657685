"""Pregrasp: hand opened along the contact normals, free of collision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.newton import NewtonRules, restore
from nlpgrasp.common.quadratic import Linearised, step_bounds
from nlpgrasp.common.rows import ON_FINGERTIP
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.nlp import HAND
from nlpgrasp.optimize.ascent.cuts import no_cuts
from nlpgrasp.optimize.surface.on_body import OnBody
from nlpgrasp.optimize.workbench.variables import hand_of, put_contacts, variables_of
from nlpgrasp.optimize.workbench.workbench import Workbench

IntArray = NDArray[np.intp]
STAGES = 4  # the clearance grows in stages, each with a few Newton steps
STAGE = NewtonRules(steps=8, enough=1e-6)  # solver units: tolerance of a stage
FINEST = 0.02  # of the clearance: the smallest stage tried
ENOUGH = 0.2  # of the clearance: above this the palm does not move
LONGEST = 0.2  # longest step, radians or solver units


@dataclass(frozen=True)
class Pregrasp:
    """Hand configuration just before contact.

    Parameters
    ----------
    clearance : float
        Distance that every fingertip has moved away along its contact normal, metres.
    hand : dict
        Values of the hand's variables; the palm is turned as in the grasp, and where it is there if joints are enough.
    """

    clearance: float
    hand: Values


def pregrasp(bench: Workbench, found: OnBody, clearance: float) -> Pregrasp:
    """Return joints that open the hand along the contact normals, free of collision.

    The joints move as little as they can while each fingertip goes back by the clearance along its normal, links
    and fingertips stay off the body, off each other and within all constraints. Where the joints alone do not
    allow that, the largest clearance that they reach is returned; where that is below a fifth the palm moves too.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a hand that has a pose.
    found : OnBody
        The grasp.
    clearance : float
        Metres.
    """
    opening = _Opening(bench, found)
    best = opening.open(clearance, ("joints",))
    if best.clearance < ENOUGH * clearance:
        best = max(best, opening.open(clearance, ("joints", "palm_position")), key=lambda p: p.clearance)
    return best


class _Opening:
    """Constraints of an opening hand: those of the program, and each fingertip's distance from its contact."""

    def __init__(self, bench: Workbench, found: OnBody) -> None:
        self.bench, self.hand, self.normals = bench, found.placed.hand, found.grasp.normals
        self.compiled = bench.exchange.compiled
        self.theta = no_cuts(bench, found.placed)
        self.start = variables_of(bench, self.compiled.program, found.placed)
        put_contacts(bench, self.compiled.program, self.start, found.grasp.points, found.grasp.normals)
        own = bench.rows.sources[len(bench.problem.constraints)]
        touching = {i for i in own if bench.rows.named[i].kind == ON_FINGERTIP}
        self.kept = np.array([i for i in range(len(bench.rows.named)) if i not in touching], int)
        self.near = np.flatnonzero(np.isin(self.kept, bench.rows.clearances))
        self.tips = bench.hand_points.tip_motion
        self.begin = self.tips(*self.hand.values())[0].full()

    def open(self, clearance: float, moving: tuple[str, ...]) -> Pregrasp:
        """Return the hand opened as far as possible with some of its variables."""
        program, z = self.compiled.program, self.start.copy()
        free = np.concatenate([np.arange(b.start, b.stop) for b in (program.block(HAND, name) for name in moving)])
        best = Pregrasp(0.0, self.hand)
        more = clearance / STAGES
        while more > clearance * FINEST and best.clearance < clearance:
            aim = min(best.clearance + more, clearance)
            there = self._opened(z, free, aim)
            if there is None:
                more /= 2.0
            else:
                z, best = there, Pregrasp(aim, hand_of(program, there))
        return best

    def _opened(self, z: FloatArray, free: IntArray, back: float) -> FloatArray | None:
        """Return the variables with every fingertip back by a distance, by Newton steps from z; None if they fail."""

        def placed(moved: FloatArray) -> FloatArray:
            result = z.copy()
            result[free] = moved
            return result

        found = restore(lambda moved: self._rows(placed(moved), free, back), z[free], STAGE)
        return placed(found.best) if found.violation <= STAGE.enough else None

    def _rows(self, z: FloatArray, free: IntArray, back: float) -> Linearised:
        """Return the constraints linearised in the free variables, without those that do not depend on them."""
        bench, program = self.bench, self.compiled.program
        size, here = bench.scaling.length, hand_of(program, z)
        rows = self.kept + program.placement.start
        g, J = self.compiled.linearise(z, self.theta)
        g, J = g[rows], J[rows][:, free]
        if isinstance(bench.problem.body, Mesh) and len(self.near):
            g[self.near] = bench.hand_points.mesh_clearances(bench.problem.body, here) / size
        places, slopes = (np.asarray(m.full()) for m in self.tips(*here.values()))
        gone = np.sum((places - self.begin) * -self.normals.T, axis=0) / size  # along the outward normals
        blocks = [program.block(HAND, name) for name in here]
        scales = np.concatenate([np.full(b.stop - b.start, b.scale) for b in blocks])
        first = blocks[0].start
        along = np.stack([-n @ slopes[3 * i : 3 * i + 3] for i, n in enumerate(self.normals)]) * scales / size
        seen = np.abs(J).sum(axis=1) > 1e-9
        low, high = (limits[rows][seen] for limits in program.limits)
        aim = np.full(len(gone), back / size)
        return Linearised(
            np.concatenate([gone, g[seen]]),
            np.concatenate([along[:, free - first], J[seen]]),
            np.concatenate([aim, low]),
            np.concatenate([aim, high]),
            *step_bounds(z[free], (program.bounds[0][free], program.bounds[1][free]), LONGEST),
        )

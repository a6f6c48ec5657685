"""Random paths of tasks for tests and the benchmark of dynamic grasping; half of them turn by over 60 degrees.

From number 100 on they are planar, on a triangle and two other polygons, with fingers of unlike friction.
"""

import time
from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from nlpgrasp.bodies import Body

COUNT, STEPS, STARTS, UNLIKE = 30, 8, 6, 100
WIDE, SMALL = (1.1, 2.0), (0.1, 0.9)  # turns in radians
PLANAR = (
    ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]]),
    ng.Polygon([[0.0, 0.0], [2.0, 0.0], [2.5, 1.0], [1.0, 2.0], [-0.3, 1.2]]),
)
TRIANGLE = ng.Polygon([[-1.0, -0.6], [1.1, -0.6], [0.2, 1.0]])
SPATIAL = (ng.Box([0.08, 0.05, 0.04]), ng.Ellipsoid([0.05, 0.03, 0.04]))


@dataclass(frozen=True)
class RandomPath:
    """Tasks whose middle, a force, turns: in the plane, or about an axis."""

    body: Body
    contacts: int
    middle: np.ndarray
    axis: np.ndarray | None
    turn: float

    def at(self, share):
        """Return the problem after this share of the turn."""
        angle = self.turn * share
        if self.axis is None:
            c, s = np.cos(angle), np.sin(angle)
            middle = [*(np.array([[c, -s], [s, c]]) @ self.middle), 0.1 * share]
            task, friction = ng.TaskEllipsoid([1.0, 0.7, 0.4], center=middle), 0.6
        else:
            turned = self.middle * np.cos(angle) + np.cross(self.axis, self.middle) * np.sin(angle)
            task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.01, 0.01, 0.01], center=[*turned, 0.0, 0.0, 0.0])
            friction = 0.8
        return ng.GraspProblem(self.body, [ng.FrictionContact(friction)] * self.contacts, task)


@dataclass(frozen=True)
class UnlikePath:
    """Tasks whose middle, a force with a moment, turns in the plane; fingers of unlike friction."""

    body: Body
    frictions: tuple[float, ...]
    middle: np.ndarray
    moment: float
    axes: np.ndarray
    turn: float

    @property
    def contacts(self):
        return len(self.frictions)

    def at(self, share):
        """Return the problem after this share of the turn."""
        c, s = np.cos(self.turn * share), np.sin(self.turn * share)
        middle = [*(np.array([[c, -s], [s, c]]) @ self.middle), self.moment]
        contacts = [ng.FrictionContact(friction) for friction in self.frictions]
        return ng.GraspProblem(self.body, contacts, ng.TaskEllipsoid(self.axes, center=middle))


@dataclass(frozen=True)
class Compared:
    """A path followed and solved cold at some of its steps: certified qualities there, 0 without a grasp.

    Seconds of CPU time are those of one step. Lost are the steps of the path without a grasp for which a cold solve, or
    any other step, has one.
    """

    followed: np.ndarray
    cold: np.ndarray
    seconds: float
    cold_seconds: float
    lost: int

    @property
    def ratio(self):
        """The least share of a cold solve's quality."""
        some = self.cold > 0.0
        return float(np.min(self.followed[some] / self.cold[some], initial=np.inf))


def random_path(number):
    """Return path ``number``: two planar ones, then a spatial one; two that turn far, then two that do not."""
    if number >= UNLIKE:
        return _unlike_path(number - UNLIKE)
    rng = np.random.default_rng(number)
    turn = float(rng.uniform(*(WIDE if number % 4 < 2 else SMALL)) * rng.choice([-1.0, 1.0]))
    if number % 3 < 2:
        middle = rng.uniform(0.3, 1.3) * _unit(rng.normal(size=2))
        return RandomPath(PLANAR[number % 2], int(rng.integers(2, 5)), middle, None, turn)
    axis = _unit(rng.normal(size=3))
    middle = rng.uniform(0.2, 0.8) * _unit(np.cross(axis, rng.normal(size=3)))
    return RandomPath(SPATIAL[number // 3 % 2], int(rng.integers(3, 5)), middle, axis, turn)


def _unlike_path(number):
    """Return a path of two or three unlike fingers; three turn by over 60 degrees, then one does not."""
    rng = np.random.default_rng(1000 + number)
    frictions = tuple(rng.uniform(0.3, 1.0) for _ in range(2 + number % 2))
    turn = np.radians(rng.uniform(60.0, 110.0) if number % 4 < 3 else rng.uniform(10.0, 60.0)) * rng.choice([-1, 1])
    middle = rng.normal(size=2)
    middle *= rng.uniform(0.6, 1.6) / np.linalg.norm(middle)
    moment, axes = rng.uniform(-0.3, 0.3), rng.uniform(0.2, 1.0, 3)
    return UnlikePath((TRIANGLE, PLANAR[1], PLANAR[0])[number % 3], frictions, middle, moment, axes, float(turn))


def compared(number, at=range(STEPS)):
    """Return path ``number`` followed and, at some of its steps, solved cold."""
    path, shares = random_path(number), np.linspace(0.0, 1.0, STEPS)
    options = ng.SolveOptions(workers=1)
    begun = time.process_time()
    try:
        steps = ng.follow_task(path.at, shares, starts=STARTS, options=options).steps
    except ng.InputError as error:
        if "no grasp found" not in str(error):
            raise
        steps = ()
    middle = time.process_time()
    cold = [ng.solve(path.at(shares[i]), STARTS, options=options) for i in at]
    cold_seconds = time.process_time() - middle
    followed = [_certified(step.solution) for step in steps] or [0.0] * STEPS
    grasps = [solution.grasp for solution in (*cold, *(step.solution for step in steps)) if solution.grasp is not None]
    tasks = [path.at(share).task for share in shares]
    lost = sum(any(_holds(g, task) for g in grasps) for f, task in zip(followed, tasks, strict=True) if f <= 0.0)
    costs = (middle - begun) / STEPS, cold_seconds / len(at)
    return Compared(np.array(followed)[list(at)], np.array([_certified(solution) for solution in cold]), *costs, lost)


def _certified(solution):
    return solution.mu.lower if solution.status is ng.Status.SOLVED else 0.0


def _holds(grasp, task):
    return ng.mu(grasp, task, rtol=0.1).lower > 0.0


def _unit(v):
    return v / np.linalg.norm(v)

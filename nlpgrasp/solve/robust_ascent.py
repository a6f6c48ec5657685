"""From a grasp to a more robust one nearby: contacts moved so that the worst of their displacements hurts less.

A displacement is which of the places around it each contact slips to. Those that hurt most so far are kept; every
contact in turn moves to the place near it where the least quality over all of them is largest, and the search for
the worst displacement begins anew. Only what the certificate confirms is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.contacts import ContactModel, less_friction
from nlpgrasp.findings import Robustness
from nlpgrasp.grasp import Grasp
from nlpgrasp.grasp_stack import GraspStack
from nlpgrasp.quality.screening import sampled_ratios
from nlpgrasp.solve.minimisers import weakest_directions
from nlpgrasp.solve.on_body import OnBody, kept
from nlpgrasp.solve.robust import Places, places_around, robustness, worst_displacement
from nlpgrasp.solve.workbench import FEASIBLE, Workbench
from nlpgrasp.validation import FloatArray

STEPS = (0.04, 0.02, 0.01, 0.005)  # of the body's size
ROUNDS = 4  # of a step size
GAIN = 1e-3  # relative: a move that gains less is none
MOST_DIRECTIONS = 400


def steadied(bench: Workbench, faces: tuple[str, ...], found: OnBody) -> tuple[OnBody, Robustness]:
    """Return what a start found, made more robust where its contacts move freely over a smooth body."""
    offset, share = bench.options.robust_offset, bench.options.robust_friction
    hand = found.hand or {}
    if found.surface is not None or not bench.follows_contacts:
        return found, robustness(bench, faces, found.grasp, hand, offset, share)
    grasp, robust = more_robust(bench, faces, found.grasp, hand, offset, share)
    return kept(bench, grasp, hand, None), robust


def more_robust(
    bench: Workbench, faces: tuple[str, ...], grasp: Grasp, hand: dict[str, FloatArray], offset: float, share: float
) -> tuple[Grasp, Robustness]:
    """Return a grasp near this one whose worst placement is better, or this one, with its robustness.

    Parameters
    ----------
    bench : Workbench
        Of a problem whose contacts move freely over the body: no hand with a pose of its own.
    faces : tuple of k str
    grasp : Grasp
    hand : dict
    offset, share : float
        How far contacts may be off, metres, and by which share friction may be less.
    """
    best = grasp, robustness(bench, faces, grasp, hand, offset, share)
    models = less_friction(grasp.contacts, share)
    points, known = grasp.points.copy(), np.zeros((0, grasp.dimension))
    displacements: list[tuple[int, ...]] = [(0,) * len(grasp)]
    for step in STEPS:
        for _ in range(ROUNDS):
            worst, known = _worst(bench, faces, models, points, hand, offset, known)
            if worst not in displacements:
                displacements.append(worst)
            moved = _move(bench, faces, models, points, hand, offset, step, displacements, known)
            if not moved:
                break
        there = bench.grasp(faces, points)
        found = robustness(bench, faces, there, hand, offset, share)
        if found.mu.lower > best[1].mu.lower:
            best = there, found
    return best


def _worst(
    bench: Workbench,
    faces: tuple[str, ...],
    models: Sequence[ContactModel],
    points: FloatArray,
    hand: dict[str, FloatArray],
    offset: float,
    known: FloatArray,
) -> tuple[tuple[int, ...], FloatArray]:
    """Return the worst displacement found of contacts, and the weak directions known."""
    places = _places(bench, faces, points, offset)
    budget = bench.budget(points, hand)
    chosen, y = worst_displacement(bench, models, places, budget, np.random.default_rng(0))
    nominal = weakest_directions(
        bench.grasp(faces, points), bench.problem.task, y, np.random.default_rng(0), budget, 60, 25
    )
    return tuple(chosen), np.concatenate([known, y, nominal.directions])[-MOST_DIRECTIONS:]


def _move(
    bench: Workbench,
    faces: tuple[str, ...],
    models: Sequence[ContactModel],
    points: FloatArray,
    hand: dict[str, FloatArray],
    offset: float,
    step: float,
    displacements: Sequence[tuple[int, ...]],
    y: FloatArray,
) -> bool:
    """Move contacts in turn, in place, to where the displacements hurt least; return whether any moved."""
    moved = False
    now = _places(bench, faces, points, offset)
    for i in range(len(points)):
        normal = bench.inward_normals(faces, points)[i]
        tried = places_around(bench, faces[i], points[i], normal, step * bench.scaling.length)[0]
        around = [now[i], *(_places(bench, faces, _with(points, i, p), offset)[i] for p in tried[1:])]
        values = np.array([_least(bench, models, [*now[:i], one, *now[i + 1 :]], displacements, y) for one in around])
        trials = np.array([_with(points, i, p) for p in tried])
        normals = np.array([bench.inward_normals(faces, p) for p in trials])
        batched = {name: np.repeat(v[None], len(trials), axis=0) for name, v in hand.items()}
        allowed = bench.violations(trials, normals, batched) <= FEASIBLE
        best = int(np.argmax(np.where(allowed, values, -np.inf)))
        if best > 0 and values[best] > (1.0 + GAIN) * values[0]:
            points[i], now[i], moved = tried[best], around[best], True
    return moved


def _least(
    bench: Workbench,
    models: Sequence[ContactModel],
    places: Places,
    displacements: Sequence[tuple[int, ...]],
    y: FloatArray,
) -> float:
    """Return the least support ratio over displacements and directions."""
    chosen = [[min(c, len(places[i][0]) - 1) for i, c in enumerate(one)] for one in displacements]
    p = np.array([[places[i][0][c] for i, c in enumerate(one)] for one in chosen])
    n = np.array([[places[i][1][c] for i, c in enumerate(one)] for one in chosen])
    stack = GraspStack(p, n, models, bench.problem.origin)
    return float(np.min(sampled_ratios(stack, bench.problem.task, y, bench.screening_budget)))


def _places(bench: Workbench, faces: tuple[str, ...], points: FloatArray, offset: float) -> Places:
    normals = bench.inward_normals(faces, points)
    each = zip(faces, points, normals, strict=True)
    return [places_around(bench, face, p, n, offset) for face, p, n in each]


def _with(points: FloatArray, i: int, point: FloatArray) -> FloatArray:
    result = points.copy()
    result[i] = point
    return result

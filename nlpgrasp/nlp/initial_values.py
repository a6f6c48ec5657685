"""Initial values of the nonlinear program: contacts, normals, hand and forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import FrictionContact, PointContact
from nlpgrasp.hands import PosedHand
from nlpgrasp.hands.base import Values
from nlpgrasp.nlp.formulation import has_closed_form, support_function
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.task_samples import TaskSamples
from nlpgrasp.problem.problem import GraspProblem

CANDIDATES = 48  # number of random candidates
PRESSING = 0.6  # units of force, L2 norm of the initial normal forces
TINY = 1e-9  # support of a task below which it counts as zero


@dataclass(frozen=True)
class StartContacts:
    """Initial contacts on faces of the body, with the variables of a posed hand.

    Parameters
    ----------
    points : (k, space) array
        Metres, body frame.
    faces : tuple of k str
    hand : dict
        Variables by name; empty for a hand that follows its contacts.
    """

    points: FloatArray
    faces: tuple[str, ...]
    hand: Values = field(default_factory=dict)


def nearest_faces(problem: GraspProblem, points: FloatArray) -> tuple[str, ...]:
    """Return the name of the allowed face nearest to each contact (k, space), metres."""

    def distance(name: str, p: FloatArray) -> float:
        h, slope, _, limit = problem.body.evaluate(name, p[None])
        return float(abs(h[0]) / max(slope[0], TINY) + max(limit[0], 0.0))

    faces = []
    for i, p in enumerate(points):
        names = problem.allowed_faces(i)
        faces.append(names[int(np.argmin([distance(name, p) for name in names]))])
    return tuple(faces)


def inward_normals(problem: GraspProblem, points: FloatArray, faces: Sequence[str]) -> FloatArray:
    """Return the inward unit normals of faces at points, (k, space) each."""
    normals, names = np.empty_like(points), np.array(faces)
    for face in set(faces):
        normals[names == face] = -problem.body.evaluate(face, points[names == face])[2]
    return normals


def pressing_forces(problem: GraspProblem, normals: FloatArray) -> FloatArray:
    """Return force variables of equal normal forces at all contacts, in units of the budget's force."""
    size = PRESSING / np.sqrt(len(normals))
    return np.concatenate([size * m.pressing(n) for m, n in zip(problem.models, normals, strict=True)])


def hand_from_contacts(problem: GraspProblem, points: FloatArray, normals: FloatArray) -> Values:
    """Return the variables, by name, of a hand that is determined by its contacts; empty for other hands."""
    hand = problem.hand
    if hand is None or not hand.follows_contacts:
        return {}
    return {name: np.ravel(v) for name, v in hand.start(points - np.array(hand.tip_radii)[:, None] * normals).items()}


def random_contacts(problem: GraspProblem, rng: np.random.Generator) -> list[StartContacts]:
    """Return random candidates, sorted by their least support along well-spread directions, largest first.

    A posed hand is drawn at random about the body, with contacts at the points of random faces nearest to its
    fingertips; closer ones rank higher.
    """
    body, count = problem.body, len(problem.models)
    allowed = [problem.allowed_faces(i) for i in range(count)]
    face_names = dict.fromkeys(name for names in allowed for name in names)
    samples = {name: body.sample(name, CANDIDATES, rng, problem.margin) for name in face_names}
    sampled_faces = [[name for name in names if len(samples[name])] for names in allowed]
    faces = [tuple(str(rng.choice(names)) for names in sampled_faces) for _ in range(CANDIDATES)]
    hand: Values = {}
    if isinstance(problem.hand, PosedHand):
        hand, tips = problem.hand.draw(CANDIDATES, np.repeat(body.centroid[None], CANDIDATES, axis=0), rng)
        pairs = zip(faces, tips, strict=True)
        points = np.array([[_nearest(samples[n], tip) for n, tip in zip(*pair, strict=True)] for pair in pairs])
        distances = np.sum(np.linalg.norm(points - tips, axis=2), axis=1) / body.size
    else:
        points = np.array([[samples[n][rng.integers(len(samples[n]))] for n in chosen] for chosen in faces])
        distances = np.zeros(CANDIDATES)
    order = np.argsort(distances - _least_supports(problem, points, faces), kind="stable")
    return [StartContacts(points[i], faces[i], {name: np.ravel(v[i]) for name, v in hand.items()}) for i in order]


def _nearest(cloud: FloatArray, point: FloatArray) -> FloatArray:
    """Return the point of a cloud (m, space) nearest to a given point."""
    return np.asarray(cloud[np.argmin(np.linalg.norm(cloud - point, axis=1))])


def _closed_form_problem(problem: GraspProblem) -> GraspProblem:
    """Return the problem, with the L2 budget and simpler contacts as far as a closed-form support needs them.

    The similar one has the L2 budget and, if that is not enough, point or friction contacts with the same friction
    coefficients.
    """
    if has_closed_form(problem):
        return problem
    l2_problem = problem.unchecked(force_budget=L2Budget())
    if has_closed_form(l2_problem):
        return l2_problem
    coefficients = [model.coefficients.get("friction") for model in problem.models]
    contacts = [PointContact() if friction is None else FrictionContact(friction) for friction in coefficients]
    return l2_problem.unchecked(contacts=contacts)


def _least_supports(problem: GraspProblem, points: FloatArray, faces: Sequence[tuple[str, ...]]) -> FloatArray:
    """Return an estimate (b,) of the least support of candidates (b, k, space), solver units."""
    scaling, ranked_problem = Scaling.of(problem), _closed_form_problem(problem)
    closed_form = support_function(ranked_problem, scaling)
    if closed_form is None:
        return np.zeros(len(points))
    normals, names = np.empty_like(points), np.array(faces)
    for name in np.unique(names):
        on_face = names == name
        normals[on_face] = -problem.body.evaluate(str(name), points[on_face])[2]
    y = TaskSamples(problem.task, scaling.wrench, 1).containing()
    reach = problem.task.support(y)[0]
    y = y[reach > TINY] / reach[reach > TINY, None]
    contact_columns = [np.repeat(v[:, i], len(y), axis=0).T for v in (points, normals) for i in range(points.shape[1])]
    phi, power = closed_form
    values = np.asarray(phi.map(len(points) * len(y))(np.tile(y, (len(points), 1)).T, *contact_columns).full())
    least = np.min(np.maximum(values, 0.0).reshape(len(points), len(y)), axis=1)
    return np.asarray(scaling.beta * least ** (1.0 / power))

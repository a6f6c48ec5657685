"""Systematic edits of every entry of a solution file, and the list of those that ``verify`` need not see."""

import copy
import pickle
import re
from collections import defaultdict
from importlib import import_module

import numpy as np

STEP, LEAST_STEP = 0.01, 1e-3  # relative step of a number; the least one, in its unit
LEFT_OUT = ("drawing", "created_by", "grasps", "schema")

# edits by what they do and where, and why they are no lie that a check has to see
NO_LIE = {
    r"^renamed name": "a name",
    r"^removed (message|hand\.fingertips)": "readers derive it",
    r"^removed .*\.(torsion_model|closing_axis|approach_axis|tcp)": "the default",
    r"^negated .*quaternion_wxyz": "of a half turn the same pose",
    r" solver\.(seconds|seed|iterations|ipopt_calls)": "effort",
    r" quality\.best_possible\.nodes": "effort",
    r" solver\.options\.(rounds|rtol|extras|global_bound|workers|analyses|edge_margin|ipopt|time_limit)": "effort",
    r"^(more|less|negated|flipped) solver\.options": "what was asked for: what is claimed stands beside it",
    r" solver\.starts": "starts hold no contacts; of the winner faces, status and interval are compared",
    r"^removed (quality\.(delta|nu|best_possible|critical_friction(\.curve(\.#)?)?)|kkt)$": "a claim less",
    r" (shadow_prices|why_not)": "never recomputed",
    r" constraints\.#\.multiplier": "never recomputed",
    r"^flipped constraints\.#\.active$": "near a limit either is true; farther off it is seen",
    r"^removed best_start$": "an answer of jaws may be of no start, and of others it is due",
    r"^swapped constraints": "an order without meaning",
    r"^(negated|swapped) problem\.task\.axes": "the same ellipsoid",
    r" problem\.(name|max_force|constraints)": "another problem that the grasp solves",
    r" problem\.hand\.(torque_limits|missing)": "another problem that the grasp solves",
    r" problem\.hand\.(spread|opening|tilt|safety_factor|approach|self_collision)": "another problem that it solves",
    r" problem\.hand\.(finger_length|finger_thickness)": "another problem that the grasp solves",
    r" quality\.mu\.worst_direction": "evidence: any direction with this support ratio",
    r" kkt\.(directions|weights|stationarity|feasibility|complementarity)": "evidence, to its tolerance",
    r"^(more|less) quality\.(delta|nu|robust\.mu)\.(lower|upper)": "true as far as the certificate proves it",
    r"^(more|less) quality\.critical_friction\.": "true as far as the certificate proves it",
    r"^(more|less) hand\.grip\.(force|with_margin)": "true as far as the certificate proves it",
    r" quality\.(delta|nu)\.torque_scale": "true as far as the certificate proves it for this scale",
    r" quality\.nu\.(value|error)": "an estimate with an error bar",
    r" quality\.robust\.positions": "another displacement, whose quality is recomputed",
    r" problem\.body\.(smoothing|resolution|repairs)|^removed problem\.body\.(unit|triangles)": "the smooth surface",
    r" grasp\.contacts\.#\.(surface_distance|surface_angle|normal_angle|moved)": "the smooth surface",
    r"^swapped (forces\.#\.moments|hand\.squeeze\.fingers\.#\.moment|hand\.tip_gaps)": "equal to rounding",
    r"^removed hand\.(link_depth|way_in)\.(thing|tolerance)$": "the default",
    r" hand\.(link_depth|way_in)\.samples": "effort",
    r"^removed problem\.task\.torque_origin": "the problem's torque origin, which is checked",
    r"^removed hand\.phases\.#$": "a keyframe less; those that others rest on are due",
    r"^(more|less|negated) hand\.pregrasp\.joint_positions": "another open posture, whose clearance is recomputed",
    r"^negated hand\.phases\.#\.clearance": "a weaker claim",
    r"^less hand\.(phases\.#\.clearance|squeeze\.normal_force)|^more hand\.squeeze\.share": "a weaker claim",
    r"tangents": "a turn about the normal, under which the friction cone stays",
}


def edits(data, rng, most=1):
    """Return edits of a file's data, as (what it does and where, edited data), some of each kind of entry."""
    groups = defaultdict(list)
    for what, path, value in _entries({k: v for k, v in data.items() if k not in LEFT_OUT}):
        if "certificate" not in path:
            name = re.sub(r"\d+", "#", ".".join(map(str, path)))
            groups[f"{what} {name}"].append((path, value))
    for name, found in groups.items():
        for i in sorted(rng.choice(len(found), min(most, len(found)), replace=False)):
            yield name, _edited(data, *found[i])


def is_no_lie(name):
    """Return whether the list above names an edit."""
    return any(re.search(pattern, name) for pattern in NO_LIE)


def _entries(data, path=()):
    """Yield what is done, the path and a function of the container and the key."""
    if path and data not in (None, [], {}):
        yield "removed", path, _remove
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _entries(value, (*path, key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            if not isinstance(value, int | float):
                yield "twice", (*path, i), _repeat
            if i and not _are_equal(value, data[i - 1]):
                yield "swapped", (*path, i), _swap
            yield from _entries(value, (*path, i))
    elif isinstance(data, bool):
        yield "flipped", path, not data
    elif isinstance(data, int | float):
        step = 1 if isinstance(data, int) else max(STEP * abs(data), LEAST_STEP)
        yield "more", path, data + step
        yield "less", path, data - step
        if abs(data) > LEAST_STEP:
            yield "negated", path, -data
    elif isinstance(data, str):
        yield "renamed", path, data + "x"


def _are_equal(a, b):
    """Whether two entries are the same, numbers to rounding."""
    is_number = isinstance(a, int | float) and isinstance(b, int | float)
    return abs(a - b) <= 1e-6 if is_number else a == b


def _remove(container, key):
    del container[key]


def _repeat(container, key):
    container.insert(key, copy.deepcopy(container[key]))


def _swap(container, key):
    container[key - 1], container[key] = container[key], container[key - 1]


def _edited(data, path, value):
    """Return the data with one entry changed; without copies of the answer among kept grasps."""
    result = copy.deepcopy({k: v for k, v in data.items() if k != "grasps"})
    container = result
    for key in path[:-1]:
        container = container[key]
    if callable(value):
        value(container, path[-1])
    else:
        container[path[-1]] = value
    return result


def remembered(monkeypatch):
    """Remember costly recomputations, so that a walk repeats those alone that an edit concerns."""

    def remember(module, name, owner=None, key=lambda *args: args):
        target = getattr(import_module(module), owner) if owner else import_module(module)
        compute, known = getattr(target, name), {}

        def recall(*args, **options):
            stated = pickle.dumps((key(*args), sorted(options.items())))
            if stated not in known:
                known[stated] = compute(*args, **options)
            return known[stated]

        monkeypatch.setattr(target, name, recall)

    def wrenches(grasp, task, rtol, budget, *more):
        models = [model.to_dict() for model in grasp.contacts]
        budget = budget if isinstance(budget, str) else budget.to_dict()
        vectors = (grasp.points, grasp.normals, grasp.tangents, grasp.torque_origin)
        return *vectors, models, task.to_dict(), rtol, budget, *more

    def posture(links, hand):
        poses = sorted((name, np.asarray(pose)) for name, pose in hand.poses.items())
        return poses, links.solution.problem, links.contacts, links.tolerance

    remember("nlpgrasp.quality.measures", "certify", key=wrenches)
    remember("nlpgrasp.verify.proved_bounds", "_prove_and_check", key=wrenches)
    remember("nlpgrasp.verify.link_checks", "_penetration", "_LinkComparison", posture)
    remember("nlpgrasp.verify.numeric_urdf_hand", "link_shapes", key=lambda path, names, *more: (path, sorted(names)))

"""Links of an MJCF file, from MuJoCo's compiled model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.hands.kinematics import Follow, Link

if TYPE_CHECKING:
    from mujoco import MjModel


def links_in_mjcf(place: Path, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first; each of several joints at one body has a link of its own.

    Torque limits are those of the solution file: the forces of an MJCF's actuators are not recomputed here.

    Parameters
    ----------
    place : Path
        An MJCF file.
    palm : str
    """
    try:
        mujoco = import_mujoco(f"{place.name}: reading MJCF")
        spec = mujoco.MjSpec.from_file(str(place))
        spec.compiler.fusestatic = False
        model = spec.compile()
    except MissingExtraError as error:
        raise NotMadeError(str(error)) from None
    except (ValueError, mujoco.FatalError) as error:
        raise NotMadeError(f"MuJoCo cannot read {place.name}: {' '.join(str(error).split())}") from None
    names = [model.body(b).name or f"body_{b}" for b in range(model.nbody)]
    found: list[Link] = []
    below = {palm}
    for b in range(1, model.nbody):
        above = names[model.body_parentid[b]]
        if above in below and names[b] != palm:
            below.add(names[b])
            found += _links(model, b, above, names[b])
    return _coupled(model, found)


def _links(model: MjModel, body: int, above: str, name: str) -> list[Link]:
    """Return a link for each joint of a body, at its anchor, and the body itself, fixed to the last of them."""
    origin = _frame(model.body_pos[body], model.body_quat[body])
    result: list[Link] = []
    for j in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        slides, joint = model.jnt_type[j] == 2, model.joint(j).name or f"joint_{j}"
        axis, zero = np.array(model.jnt_axis[j]), float(model.qpos0[model.jnt_qposadr[j]])
        there = origin @ _frame(model.jnt_pos[j])
        if slides:
            there = there @ _frame(-zero * axis)
        else:
            there[:3, :3] = there[:3, :3] @ Rotation.from_rotvec(-zero * axis).as_matrix()
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
        own = f"{name}, {joint}"
        kind = "prismatic" if slides else "revolute"
        result.append(Link(own, above, joint, kind, there, axis, float(low), float(high), None))
        above, origin = own, _frame(-model.jnt_pos[j])
    fixed = f"{name}, fixed"
    return [*result, Link(name, above, fixed, "fixed", origin, np.array([1.0, 0.0, 0.0]), 0.0, 0.0, None)]


def _coupled(model: MjModel, links: list[Link]) -> tuple[Link, ...]:
    """Return the links with mimic joints from equalities of joints, then of tendons of two joints."""
    every = {link.joint: link for link in links}
    tied = [e for e in range(model.neq) if model.eq_active0[e]]
    for e in (e for e in tied if model.eq_type[e] == 2):
        first, second = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        name, start = model.joint(first).name or f"joint_{first}", model.qpos0[model.jnt_qposadr[first]]
        if name not in every:
            continue
        a, b = (float(v) for v in model.eq_data[e][:2])
        if second < 0:
            held = every[name].step(float(start) + a)
            every[name] = replace(every[name], kind="fixed", origin=held, lower=0.0, upper=0.0)
        else:
            other, zero = model.joint(second).name or f"joint_{second}", model.qpos0[model.jnt_qposadr[second]]
            every[name] = replace(every[name], follow=Follow(other, b, float(start + a - b * zero)))
    for e in (e for e in tied if model.eq_type[e] == 3 and model.eq_obj2id[e] < 0):
        t = int(model.eq_obj1id[e])
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        arms = {int(model.wrap_objid[w]): float(model.wrap_prm[w]) for w in wraps if model.wrap_type[w] == 1}
        named = {model.joint(j).name or f"joint_{j}": arm for j, arm in arms.items()}
        total = sum(arm * model.qpos0[model.jnt_qposadr[j]] for j, arm in arms.items()) + model.eq_data[e][0]
        if len(named) == 2 and set(named) <= set(every):
            first_name, last = sorted(named, key=list(every).index)
            for other, name in ((first_name, last), (last, first_name)):
                if every[name].follow is None and every[name].moves and _driver(every, other)[0] != name:
                    follow = Follow(other, -named[other] / named[name], float(total / named[name]))
                    tried = every | {name: replace(every[name], follow=follow)}
                    every = tried if _has_room(tried) else every
                    break
    return tuple(_closed(link) for link in every.values())


def _driver(links: dict[str, Link], joint: str) -> tuple[str, float, float]:
    """Return the free joint that drives a joint, with multiplier and offset."""
    rate, offset = 1.0, 0.0
    while (follow := links[joint].follow) is not None:
        rate, offset, joint = rate * follow.multiplier, rate * follow.offset + offset, follow.joint
    return joint, rate, offset


def _has_room(links: dict[str, Link]) -> bool:
    """Return whether the limits of all joints leave each driver a nonempty range."""
    room = {name: [link.lower, link.upper] for name, link in links.items() if link.moves and link.follow is None}
    for name, link in links.items():
        if link.moves and link.follow is not None:
            driver, rate, offset = _driver(links, name)
            if rate != 0.0:
                ends = sorted(((link.lower - offset) / rate, (link.upper - offset) / rate))
                room[driver] = [max(room[driver][0], ends[0]), min(room[driver][1], ends[1])]
    return all(low < high for low, high in room.values())


def _closed(link: Link) -> Link:
    """Return the link with half a turn either way for a free hinge without a range."""
    free = link.kind == "revolute" and link.follow is None and not np.isfinite(link.upper)
    return replace(link, kind="continuous", lower=-np.pi, upper=np.pi) if free else link


def _frame(position: FloatArray, quaternion: FloatArray | None = None) -> FloatArray:
    frame = np.eye(4)
    frame[:3, 3] = position
    if quaternion is not None:
        frame[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return frame

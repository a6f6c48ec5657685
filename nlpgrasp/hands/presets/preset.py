"""Preset: the fixed data of a known hand, and its construction from a URDF."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NoReturn, TypedDict, Unpack

from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.robot.robot_file import read_robot, robot_links
from nlpgrasp.hands.tips import CapsuleTip, SphereTip, Tip
from nlpgrasp.hands.tips.of_shape import tip_of
from nlpgrasp.hands.urdf.urdf_hand import URDFHand

Direction = tuple[float, float, float]
CLEARANCE = 2e-3  # metres between links and body, for the positioning error of an arm


class Options(TypedDict, total=False):
    """Keyword arguments of a preset, with the meaning of those of ``URDFHand.load``.

    ``palm`` selects one of two hands in a URDF; ``torque_limits`` and ``clearance`` replace the preset's.
    """

    palm: str
    torque_limits: Mapping[str, float] | float
    clearance: float
    spheres_per_link: int
    self_collision: bool


@dataclass(frozen=True)
class Preset:
    """Fixed data of a hand model: palm, fingertips, approach and limits.

    Parameters
    ----------
    name : str
        Of the function that makes it.
    palms : tuple of str
        Names of the palm's link, with any prefix: the first that all fingertips hang from.
    tips : mapping
        Link (with any prefix) to its fingertip, or to a function of the joint above the link that returns it.
    approach : (3,) tuple
        Direction in which the palm faces, palm frame.
    limits : function
        Of the robot, to torque limits by joint.
    description : str
        Module of ``robot_descriptions`` that holds its URDF, empty where there is none.
    """

    name: str
    palms: tuple[str, ...]
    tips: Mapping[str, Tip | Callable[[Joint], Tip]]
    approach: Direction
    limits: Callable[[Robot], Mapping[str, float]]
    description: str = ""

    def hand(self, urdf: str | Path | None, **options: Unpack[Options]) -> URDFHand:
        """Return the hand of a URDF or MJCF file.

        A spherical tip is the capsule instead where that is the collision shape of the link in the file.

        Parameters
        ----------
        urdf : str or Path, optional
            Found through the package ``robot_descriptions`` when left out.
        **options
            Of ``Options``.

        Raises
        ------
        InputError
            When there is no URDF, or it lacks a link of this hand.
        """
        path = self._described() if urdf is None else urdf
        robot = read_robot(path, options["palm"]) if "palm" in options else self._from_palm(path)
        self._check_tips(path, [robot])
        options["palm"] = robot.root
        above = {joint.child: joint for joint in robot.joints}
        tips: dict[str, float | Tip | Sequence[Tip]] = {}
        for name, tip in self.tips.items():
            link = self._tip(path, robot, name)
            own = tip_of(robot.shapes.get(link, ()))
            stated = tip if isinstance(tip, Tip) else tip(above[link])
            tips[link] = own if isinstance(own, CapsuleTip) and isinstance(stated, SphereTip) else stated
        options.setdefault("torque_limits", self.limits(robot))
        options.setdefault("clearance", CLEARANCE)
        return URDFHand.load(path, tips, approach=self.approach, **options)

    def _from_palm(self, path: str | Path) -> Robot:
        """Return the robot below the palm: a link with one of its names that all fingertips hang from.

        A frame of that name without fingers is no palm. Among nested links with the same name but for prefixes, such as
        the bases of an arm and of its hand, it is the innermost.
        """
        links = robot_links(path)
        candidates: list[Robot] = []
        broken: list[InputError] = []
        for name in self.palms:
            holding: list[Robot] = []
            for link in self._matches(links, name):
                try:
                    robot = read_robot(path, link)
                except InputError as error:  # an arm's joint of an unsupported kind below a link of this name
                    broken.append(error)
                    continue
                candidates.append(robot)
                holding += [] if self._without(robot) else [robot]
            inner = [r for r in holding if not any(o.root in r.links for o in holding if o is not r)]
            exact = [r for r in inner if r.root == name]
            if len(inner) > 1 and not exact:
                given = f"{Path(path).name} with links {', '.join(r.root for r in inner)}"
                raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")
            if inner:
                return (exact or inner)[0]
        if broken:
            raise broken[0]
        if not candidates:
            self._refuse(f"{Path(path).name} without a link {' or '.join(self.palms)}")
        self._check_tips(path, candidates)
        return candidates[0]

    def _check_tips(self, path: str | Path, robots: Sequence[Robot]) -> None:
        """Refuse a file in which no palm carries all fingertips; the message names what is missing."""
        lacking = {robot.root: self._without(robot) for robot in robots}
        if not all(lacking.values()):
            return
        links = robot_links(path)
        absent = [tip for tip in self.tips if not self._matches(links, tip)]
        if absent:
            self._refuse(f"{Path(path).name} without a link {absent[0]}")
        apart = "; ".join(f"{', '.join(tips)} not below {palm}" for palm, tips in lacking.items())
        self._refuse(f"{Path(path).name} with {apart}")

    def _without(self, robot: Robot) -> list[str]:
        """Return the fingertips that do not hang from a robot's root, by their names in the preset."""
        return [tip for tip in self.tips if not self._matches(robot.links, tip)]

    def _matches(self, links: Sequence[str], name: str) -> list[str]:
        """Return the links with a name, whatever their prefix."""
        longer = [other for other in self.tips if other.endswith(f"_{name}")]  # thumb_fingertip is not a fingertip
        return [link for link in links if _is(link, name) and not any(_is(link, other) for other in longer)]

    def _tip(self, path: str | Path, robot: Robot, name: str) -> str:
        """Return a fingertip's link: the one with exactly this name, or the only one with a prefix."""
        matches = [name] if name in robot.links else self._matches(robot.links, name)
        if len(matches) > 1:
            given = f"{Path(path).name} with links {', '.join(matches)}"
            raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")
        return matches[0]

    def _refuse(self, given: str) -> NoReturn:
        raise InputError(f"hands.{self.name}.urdf", given, "the URDF of this hand; ng.URDFHand.load takes any other")

    def _described(self) -> str:
        field = f"hands.{self.name}.urdf"
        if not self.description:
            raise InputError(field, "nothing", "the path of its URDF (robot_descriptions has none of this hand)")
        try:
            module = import_module(f"robot_descriptions.{self.description}")
        except ModuleNotFoundError:
            install = 'pip install "nlpgrasp[descriptions]"'
            raise InputError(field, "nothing", f"the path of its URDF, or robot_descriptions: {install}") from None
        except Exception as error:  # robot_descriptions clones a repository: any error of git or the network
            given = f"{self.description}, which robot_descriptions cannot fetch ({type(error).__name__}: {error})"
            raise InputError(field, given, "the path of its URDF") from None
        path = getattr(module, "URDF_PATH", None)
        if path is None:
            given = f"{self.description}, of which robot_descriptions has no plain URDF"
            raise InputError(field, given, "the path of its URDF")
        return str(path)


def _is(link: str, name: str) -> bool:
    """Return whether a link has a name, with any prefix."""
    return link == name or link.endswith(tuple(f"{mark}{name}" for mark in "_:/"))


def same_for_all(torque: float) -> Callable[[Robot], Mapping[str, float]]:
    """Return equal limits for all joints, newton-metres, as a function of the robot."""
    return lambda robot: {joint.name: torque for joint in robot.free_joints}


def by_ending(limits: Mapping[str, float]) -> Callable[[Robot], Mapping[str, float]]:
    """Return limits by the endings of joint names; the URDF's efforts for the other joints."""

    def of(robot: Robot) -> Mapping[str, float]:
        efforts = {joint.name: joint.effort for joint in robot.free_joints if joint.effort}
        ends = {j.name: t for j in robot.free_joints for end, t in limits.items() if j.name.endswith(end)}
        return {**efforts, **ends}

    return of


def of_urdf(robot: Robot) -> Mapping[str, float]:
    """Return the efforts that the URDF states."""
    return {joint.name: joint.effort for joint in robot.free_joints if joint.effort}

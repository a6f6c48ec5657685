"""What a preset states of a hand, and the hand that it makes of a URDF."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TypedDict, Unpack

from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.robot.robot_file import read_robot, robot_links
from nlpgrasp.hands.tips import CapsuleTip, SphereTip, Tip
from nlpgrasp.hands.tips.of_shape import tip_of
from nlpgrasp.hands.urdf.urdf_hand import URDFHand

Direction = tuple[float, float, float]
CLEARANCE = 2e-3  # metres: no arm comes to the palm's place more exactly, and what touches too early pushes the object


class Options(TypedDict, total=False):
    """What may be said of a preset's hand, with the meaning that ``URDFHand.load`` gives it.

    ``palm`` tells two hands of one URDF apart; ``torque_limits`` and ``clearance`` replace the preset's, which is 2 mm.
    """

    palm: str
    torque_limits: Mapping[str, float] | float
    clearance: float
    spheres_per_link: int
    self_collision: bool


@dataclass(frozen=True)
class Preset:
    """A hand as its maker builds it.

    Parameters
    ----------
    name : str
        Of the function that makes it.
    palms : tuple of str
        Names of the palm's link, the first that is there; with any prefix.
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
        """Return the hand of a URDF or an MJCF.

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
        if "palm" not in options:
            options["palm"] = self._named(path, robot_links(path), self.palms)
        robot = read_robot(path, options["palm"])
        above = {joint.child: joint for joint in robot.joints}
        tips: dict[str, float | Tip | Sequence[Tip]] = {}
        for name, tip in self.tips.items():
            link = self._named(path, robot.links, (name,))
            own = tip_of(robot.shapes.get(link, ()))
            stated = tip if isinstance(tip, Tip) else tip(above[link])
            tips[link] = own if isinstance(own, CapsuleTip) and isinstance(stated, SphereTip) else stated
        options.setdefault("torque_limits", self.limits(robot))
        options.setdefault("clearance", CLEARANCE)
        return URDFHand.load(path, tips, approach=self.approach, **options)

    def _named(self, path: str | Path, links: Sequence[str], wanted: Sequence[str]) -> str:
        """Return the link with one of the names wanted, whatever its prefix."""
        for name in wanted:
            longer = [other for other in self.tips if other.endswith(f"_{name}")]  # a thumb_fingertip is no fingertip
            prefixed = [link for link in links if _is(link, name) and not any(_is(link, other) for other in longer)]
            found = [name] if name in links else prefixed
            if len(found) > 1:
                given = f"{Path(path).name} with links {', '.join(found)}"
                raise InputError(f"hands.{self.name}.palm", given, "which of the hands it is, by its palm's link")
            if found:
                return found[0]
        given = f"{Path(path).name} without a link {' or '.join(wanted)}"
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
        except Exception as error:  # it clones a repository: whatever git and the network raise
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
    """Return limits that are the same for all joints, newton-metres."""
    return lambda robot: {joint.name: torque for joint in robot.free_joints}


def by_ending(limits: Mapping[str, float]) -> Callable[[Robot], Mapping[str, float]]:
    """Return limits by the ends of the joints' names; the URDF's efforts for the other joints."""

    def of(robot: Robot) -> Mapping[str, float]:
        efforts = {joint.name: joint.effort for joint in robot.free_joints if joint.effort}
        ends = {j.name: t for j in robot.free_joints for end, t in limits.items() if j.name.endswith(end)}
        return {**efforts, **ends}

    return of


def of_urdf(robot: Robot) -> Mapping[str, float]:
    """Return the URDF's own efforts."""
    return {joint.name: joint.effort for joint in robot.free_joints if joint.effort}

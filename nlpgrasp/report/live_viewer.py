"""Interactive viewer of a grasp on a local server, with sliders for task wrenches and the hand."""

from __future__ import annotations

import base64
import contextlib
import io
import logging
import socket
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.display import has_display, open_browser
from nlpgrasp.common.formatting import format_interval, format_number
from nlpgrasp.common.optional_packages import import_viser
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, integer
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.linked_hand import LinkedHand
from nlpgrasp.report.grasp_scene import body_surface, solution_scene
from nlpgrasp.report.key_figures import verdict
from nlpgrasp.report.scene_parts import view_directions
from nlpgrasp.report.task_wrenches import ChosenWrench, choose_wrenches, describe_wrench_by_axis
from nlpgrasp.solution.phase_record import GRASP, LIFT, Phase
from nlpgrasp.solution.solution import GraspSolution

RETREAT = 0.6  # share of the body's size: retreat of free fingertips
FULL_SHARE = 100.0  # per cent: the whole task
ARROW_HEAD = 2.4  # radius of an arrow's head over its shaft's
LEAST_ARROW = 1e-3  # share of the task below which no arrow is drawn
OPACITY = {"link": 0.6, "tip": 0.85, "obstacle": 0.45, "table": 0.5}  # opacity by group
FREE_TIP = 0.5  # opacity of free fingertips
DISC_SIDES = 32  # sides of a disc
DISC_HEIGHT = 0.006  # share of the body's size: height of discs over the surface
CAMERA_DISTANCE = 2.9  # distance of the camera from the body's middle, in body sizes
GRID_CELLS = 12  # grid cells along a side of a table
HOST = "127.0.0.1"
LARGEST_PORT = 65535


_viewers: dict[int, Viewer] = {}  # by port: a new grasp replaces the previous one


def show_live(solution: GraspSolution, port: int | None = None, hand: Hand | None = None) -> str | None:
    """Show a grasp in the local viewer, and return the page's address.

    A script waits until Ctrl-C.

    Parameters
    ----------
    solution : GraspSolution
    port : int or None
        None for the previously used port, or a free one.
    hand : Hand or None
        The hand of the problem, for a slider over its approach; the solution of a solve knows it.

    Returns
    -------
    str or None
        None, after a message, without the extra, where the port is taken, or without a port and a display; None too
        without a grasp to draw, and without a port where no browser opens.

    Raises
    ------
    InputError
        On an invalid port, and another hand.
    """
    if port is not None:
        integer("show.port", port, at_least=1, at_most=LARGEST_PORT)
    if hand is None and solution.source is not None:
        hand = solution.source.hand
    check_hand_of_problem(solution, hand)
    solution = replace(solution, drawing=solution.drawn())
    if solution.grasp is None or body_surface(solution) is None:
        return None
    if port is None and not has_display():
        _explain("there is no display. show(port=8080) serves the page with sliders to a browser elsewhere")
        return None
    try:
        viser = import_viser("a view with sliders")
    except MissingExtraError as error:
        _explain(str(error))
        return None
    viewer = start_viewer(viser, solution, port, hand)
    if viewer is None:
        _explain(f"port {port} is taken")
        return None
    if not (has_display() and open_browser(viewer.address)) and port is None:
        stop(viewer.port)
        return None
    sys.stdout.write(f"The grasp is shown at {viewer.address}\n")
    _wait(viewer.port)
    return viewer.address


def start_viewer(
    viser: ModuleType, solution: GraspSolution, port: int | None = None, hand: Hand | None = None
) -> Viewer | None:
    """Start a viewer of a grasp at a port, by default a free one; return ``None`` if the port is taken."""
    chosen_port = next(iter(_viewers), None) if port is None else port
    if chosen_port not in _viewers:
        chosen_port = _free_port(0 if port is None else port)
        if chosen_port is None:
            return None
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
            viewer = Viewer(viser, HOST, chosen_port)
        if viewer.port != chosen_port:  # taken in the meantime
            viewer.stop()
            return None
        _viewers[chosen_port] = viewer
    _viewers[chosen_port].show(solution, hand)
    return _viewers[chosen_port]


def stop(port: int) -> None:
    """Stop this process's viewer at a port."""
    with contextlib.redirect_stdout(io.StringIO()):
        _viewers.pop(port).stop()


def _free_port(port: int) -> int | None:
    """Return the port if it is free, or any free port for 0; return ``None`` for a port that is taken."""
    with socket.socket() as probe:
        if sys.platform != "win32":  # on Windows it would share a taken port
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return None
        return int(probe.getsockname()[1])


def _wait(port: int) -> None:
    """Block a script until Ctrl-C; return at once at a prompt and in a notebook."""
    if hasattr(sys, "ps1") or sys.flags.interactive or "ipykernel" in sys.modules:
        return
    sys.stdout.write("Ctrl-C ends it.\n")
    with contextlib.suppress(KeyboardInterrupt):
        threading.Event().wait()
    stop(port)


def _explain(reason: str) -> None:
    """Print the reason why the report is written to a file instead of shown in the viewer."""
    sys.stdout.write(f"The report is written to a file instead: {reason}\n")


class Viewer:
    """Local viser server that draws one grasp at a time.

    Parameters
    ----------
    viser : module
    host : str
    port : int
    """

    def __init__(self, viser: ModuleType, host: str, port: int) -> None:
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # a closed browser is not an error
        self.server: Any = viser.ViserServer(host=host, port=port, label="nlpgrasp", verbose=False)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        self.host = host
        self.port = int(self.server.get_port())

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{self.host}:{self.port}"

    def show(self, solution: GraspSolution, hand: Hand | None = None) -> None:
        """Draw a solution in place of the previous one.

        With the hand, the approach can be moved along too.
        """
        chosen = choose_wrenches(solution)
        data = solution_scene(solution, chosen)
        if data is None:
            return
        self.server.scene.reset()
        self.server.gui.reset()
        self._set_camera(data)
        links = {name: part for name, part in self._draw_surfaces(data) if name}
        tips = self._draw_contacts(data)
        for i, table in enumerate(data["tables"]):
            side = 2.0 * float(table["half"])
            self.server.scene.add_grid(
                f"/table/{i}",
                width=side,
                height=side,
                cell_size=side / GRID_CELLS,
                section_size=side,
                position=table["at"],
            )
        approach = approach_frames(solution, data, links, tips, hand)
        self.controls = Controls(self.server, solution, chosen, data, approach, [*links.values(), *tips])

    def stop(self) -> None:
        """End the server."""
        self.server.stop()

    def _set_camera(self, data: Json) -> None:
        """Set the camera to the report's initial view."""
        frame = np.asarray(data["frame"], dtype=float)
        middle, size = (frame.min(axis=0) + frame.max(axis=0)) / 2.0, float(data["size"])
        azimuth, elevation = np.radians(data["view"])
        direction = view_directions(azimuth, elevation)
        camera = self.server.initial_camera
        camera.near, camera.far = 0.02 * size, 100.0 * size
        camera.look_at, camera.position = tuple(middle), tuple(middle + CAMERA_DISTANCE * size * direction)

    def _draw_surfaces(self, data: Json) -> list[tuple[str, Any]]:
        """Draw the surfaces, and return name and handle of each.

        The name is empty for parts that are no link of the hand.
        """
        handles = []
        for i, part in enumerate(data["parts"]):
            group = part["group"]
            handle = self.server.scene.add_mesh_simple(
                f"/{group}/{i}",
                vertices=unpack(part["positions"], "<f4").reshape(-1, 3),
                faces=unpack(part["faces"], "<u4" if part["wide"] else "<u2").reshape(-1, 3),
                color=rgb("finger" if group == "tip" else group),
                opacity=OPACITY.get(group),
            )
            handles.append((part["name"] if group in ("link", "tip") else "", handle))
        return handles

    def _draw_contacts(self, data: Json) -> list[Any]:
        """Draw the numbered contacts, and return the handles of free fingertips."""
        tips, scene = [], self.server.scene
        for i, contact in enumerate(data["contacts"]):
            point, inward = np.array(contact["at"]), np.array(contact["inward"])
            vertices, faces = disc(point - DISC_HEIGHT * data["size"] * inward, inward, data["lengths"]["disc"])
            scene.add_mesh_simple(f"/contact/{i}", vertices, faces, color=rgb("finger"), side="double")
            scene.add_label(f"/contact/{i}/number", str(i), position=tuple(point - 0.2 * data["size"] * inward))
            if contact["tip"] > 0.0:
                centre = tuple(point - contact["tip"] * inward)
                tips.append(
                    scene.add_icosphere(f"/hand/{i}", contact["tip"], rgb("finger"), opacity=FREE_TIP, position=centre)
                )
        return tips


class Controls:
    """Sliders that change force arrows and hand, with a text about the forces.

    Parameters
    ----------
    server : viser.ViserServer
    solution : GraspSolution
        With a grasp.
    chosen : sequence of ChosenWrench
        Wrenches of the slider; empty for a grasp that holds none.
    data : mapping
        The scene.
    approach : ApproachFrames or None
        Approach of the hand.
    hand : sequence of handle
        Drawn parts of the hand.
    """

    def __init__(
        self,
        server: Any,
        solution: GraspSolution,
        chosen: Sequence[ChosenWrench],
        data: Json,
        approach: ApproachFrames | None,
        hand: Sequence[Any],
    ) -> None:
        self.server, self.solution, self.chosen, self.data = server, solution, chosen, data
        gui = server.gui
        quality = " to ".join(format_interval(solution.mu.lower, solution.mu.upper))
        gui.add_markdown(
            f"### {_escape_markdown(solution.name)}\n{verdict(solution)[0]}, certified {solution.label} {quality}"
        )
        if chosen:
            self.wrench_slider = gui.add_slider("Task wrench", 0, max(len(chosen) - 1, 1), 1, 0)
            self.fraction_slider = gui.add_slider("Share of it, %", 0.0, FULL_SHARE, 1.0, FULL_SHARE)
            self.force_text = gui.add_markdown("")
            for slider in (self.wrench_slider, self.fraction_slider):
                slider.on_update(lambda _: self.draw_forces())
            self.draw_forces()
        if approach is not None:
            end = float(len(approach.names) - 1)
            self.approach_slider = gui.add_slider("Hand", 0.0, end, 0.02, float(approach.grasp))
            self.position_text = gui.add_markdown(approach.format_position(float(approach.grasp)))
            self.approach_slider.on_update(lambda _: self.move_hand(approach))
        if hand:
            self.visibility_box = gui.add_checkbox("Show the hand", True)
            self.visibility_box.on_update(lambda _: self.set_visibility(hand))

    def draw_forces(self) -> None:
        """Draw the finger forces for the selected fraction of a task wrench, and show them in newtons."""
        i = min(int(self.wrench_slider.value), len(self.chosen) - 1)
        fraction = float(self.fraction_slider.value) / FULL_SHARE
        arrows = np.asarray(self.data["arrows"][i], dtype=float)
        shaft = float(self.data["lengths"]["shaft"])
        tails = arrows[:, 1] - fraction * (arrows[:, 1] - arrows[:, 0])
        self.server.scene.add_arrows(
            "/forces",
            np.stack([tails, arrows[:, 1]], axis=1),
            tuple(bytes.fromhex(COLOURS["force"].removeprefix("#"))),
            shaft_radius=shaft,
            head_radius=ARROW_HEAD * shaft,
            head_length=2.0 * ARROW_HEAD * shaft,
            visible=fraction > LEAST_ARROW,
        )
        self.force_text.content = self.format_forces(i, fraction)

    def format_forces(self, i: int, fraction: float) -> str:
        """Return a Markdown text on a fraction of a task wrench and the finger forces for it."""
        grasp, chosen = self.solution.require_grasp(), self.chosen[i]
        name = chosen.label.partition(":")[0]
        lines = [
            f"**{name}:** {describe_wrench_by_axis(fraction * chosen.wrench, grasp.mean_arm)}",
            "",
            "| finger | normal force | tangential force |",
        ]
        lines.append("| --- | --- | --- |")
        for k, (force, normal) in enumerate(zip(fraction * chosen.forces, grasp.normals, strict=True)):
            lines.append(f"| {k} | {_newtons(force @ normal)} | {_newtons(_tangential_size(force, normal))} |")
        return "\n".join(lines)

    def move_hand(self, approach: ApproachFrames) -> None:
        """Move the hand to the slider's position."""
        position = float(self.approach_slider.value)
        approach.move_to(position)
        self.position_text.content = approach.format_position(position)

    def set_visibility(self, hand: Sequence[Any]) -> None:
        """Set the visibility of the hand."""
        for part in hand:
            part.visible = bool(self.visibility_box.value)


def _tangential_size(force: FloatArray, normal: FloatArray) -> float:
    """Return the magnitude of a force's tangential component."""
    return float(np.linalg.norm(force - (force @ normal) * normal))


def _newtons(value: float) -> str:
    """Return a force as text in newtons."""
    return f"{format_number(float(value), 3, 1e-4)} N"


def _escape_markdown(name: str) -> str:
    """Return a name without characters that Markdown could interpret."""
    return "".join(c for c in name if c.isalnum() or c in " -.,:()")


@dataclass(frozen=True)
class ApproachFrames:
    """Approach path of a hand.

    Parameters
    ----------
    names : tuple of str
        Names of the keyframes.
    grasp : int
        Index of the grasp's keyframe.
    move_to : callable
        Moves the drawn parts to a position on the path, from 0 to the index of the last keyframe.
    """

    names: tuple[str, ...]
    grasp: int
    move_to: Callable[[float], None]

    def format_position(self, position: float) -> str:
        """Return a position on the path as text."""
        name = self.names[int(position)]
        return name if position == int(position) else f"{name} to {self.names[int(position) + 1]}"


def check_hand_of_problem(solution: GraspSolution, hand: Hand | None) -> None:
    """Raise if the hand is not the problem's.

    Raises
    ------
    InputError
        Naming the hand.
    """
    hand_data = solution.problem.get("hand") or {}
    offered = {} if hand is None else hand.to_dict() if isinstance(hand, Hand) else {"type": type(hand).__name__}
    if hand is not None and any(offered.get(key) != hand_data.get(key) for key in ("type", "sha256")):
        raise InputError("show.hand", offered.get("source", offered["type"]), "the hand that the grasp was found with")


def approach_frames(
    solution: GraspSolution, data: Json, links: Mapping[str, Any], tips: Sequence[Any], hand: Hand | None = None
) -> ApproachFrames | None:
    """Return the approach of a hand with links or of free fingertips, or ``None`` for other hands.

    Parameters
    ----------
    solution : GraspSolution
    data : mapping
        Scene of the solution.
    links : mapping of str to handle
        Drawn parts of the hand's links, by name.
    tips : sequence of handle
        Free fingertips.
    hand : Hand or None
        The hand with the links.
    """
    if tips:
        return _fingertip_approach(data, tips)
    phases = [phase for phase in solution.phases if phase.name != LIFT]  # in a lift the body moves along
    if not links or [phase.name for phase in phases].count(GRASP) != 1 or len(phases) < 2:
        return None
    return _link_approach(hand, phases, links) if isinstance(hand, LinkedHand) else None


def interpolate_hand(phases: Sequence[Phase], position: float) -> Phase:
    """Return the hand's phase at a position between two keyframes, interpolated linearly.

    The palm keeps its orientation.
    """
    index = min(int(position), len(phases) - 2)
    t, start, end = position - index, phases[index], phases[index + 1]
    joints = {name: (1.0 - t) * value + t * end.joints[name] for name, value in start.joints.items()}
    palm_position = (1.0 - t) * start.palm_position + t * end.palm_position
    return replace(start, palm_position=palm_position, joints=joints)


def _link_approach(hand: LinkedHand, phases: Sequence[Phase], links: Mapping[str, Any]) -> ApproachFrames:
    """Return the approach of a hand with links as movable frames."""
    names = tuple(phase.name for phase in phases)
    grasp = names.index(GRASP)
    drawn_poses = _body_link_poses(hand, phases[grasp])

    def move_to(position: float) -> None:
        for name, pose in _body_link_poses(hand, interpolate_hand(phases, position)).items():
            if name in links:
                displacement = pose @ np.linalg.inv(drawn_poses[name])
                links[name].wxyz = Rotation.from_matrix(displacement[:3, :3]).as_quat(scalar_first=True)
                links[name].position = displacement[:3, 3]

    return ApproachFrames(names, grasp, move_to)


def _body_link_poses(hand: LinkedHand, phase: Phase) -> dict[str, FloatArray]:
    """Return the poses (4, 4) of the links in the body's frame."""
    return hand.tree.body_poses(hand.values_of(phase.to_dict()))


def _fingertip_approach(data: Json, tips: Sequence[Any]) -> ApproachFrames:
    """Return the approach of free fingertips, along their contacts' normals."""
    contacts = [contact for contact in data["contacts"] if contact["tip"] > 0.0]  # "tip": the fingertip's radius

    def move_to(position: float) -> None:
        """Place the fingertips: at 0 away from the body, at 1 in the grasp."""
        for contact, tip in zip(contacts, tips, strict=True):
            distance = contact["tip"] + (1.0 - position) * RETREAT * float(data["size"])
            tip.position = np.array(contact["at"]) - distance * np.array(contact["inward"])

    return ApproachFrames(("away", GRASP), 1, move_to)


def unpack(text: str, kind: str) -> FloatArray:
    """Return the numbers packed by ``report.scene_parts.pack``."""
    return np.asarray(np.frombuffer(base64.b64decode(text), kind))


def rgb(role: str) -> tuple[int, int, int]:
    """Return the reports' colour for a role as red, green and blue, from 0 to 255."""
    red, green, blue = bytes.fromhex(COLOURS[role].removeprefix("#"))
    return red, green, blue


def disc(centre: FloatArray, normal: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return vertices (n, 3) and triangles (m, 3) of a flat disc."""
    tangent = np.linalg.svd(normal[None])[2][1]
    angles = np.linspace(0.0, 2.0 * np.pi, DISC_SIDES, endpoint=False)[:, None]
    ring = centre + radius * (np.cos(angles) * tangent + np.sin(angles) * np.cross(normal, tangent))
    rim = np.arange(1, DISC_SIDES + 1)
    faces = np.column_stack([np.zeros(DISC_SIDES, dtype=int), rim, np.roll(rim, -1)])
    return np.vstack([centre, ring]), faces

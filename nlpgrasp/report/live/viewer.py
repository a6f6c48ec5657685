"""Viser viewer of a grasp, with the same scene data as the HTML report."""

from __future__ import annotations

import base64
import logging
from types import ModuleType
from typing import Any

import numpy as np

from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Hand
from nlpgrasp.report.live.controls import Controls
from nlpgrasp.report.live.way import hand_way
from nlpgrasp.report.scene.scene import scene
from nlpgrasp.report.solution.chosen_wrenches import chosen_wrenches
from nlpgrasp.solution.solution import GraspSolution

GLASS = {"link": 0.6, "tip": 0.85, "obstacle": 0.45, "table": 0.5}  # opacity by group
FREE_TIP = 0.5
SIDES = 32  # sides of a disc
OVER = 0.006  # share of the body's size: height of discs over the surface
AWAY = 2.9  # distance of the camera from the body's middle, in body sizes
CELLS = 12  # grid cells along a side of a table


class Viewer:
    """A local viser server that draws one grasp at a time.

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
        """Draw a solution that has a grasp, in place of the previous one; with its hand, the approach too."""
        chosen = chosen_wrenches(solution)
        data = scene(solution, chosen)
        if data is None:
            return
        self.server.scene.reset()
        self.server.gui.reset()
        self._look(data)
        links = {name: part for name, part in self._parts(data) if name}
        tips = self._contacts(data)
        for i, table in enumerate(data["tables"]):
            wide = 2.0 * float(table["half"])
            self.server.scene.add_grid(
                f"/table/{i}", width=wide, height=wide, cell_size=wide / CELLS, section_size=wide, position=table["at"]
            )
        way = hand_way(solution, data, links, tips, hand)
        self.controls = Controls(self.server, solution, chosen, data, way, [*links.values(), *tips])

    def stop(self) -> None:
        """End the server."""
        self.server.stop()

    def _look(self, data: Json) -> None:
        """Set the camera to the report's initial view."""
        frame = np.asarray(data["frame"], dtype=float)
        middle, size = (frame.min(axis=0) + frame.max(axis=0)) / 2.0, float(data["size"])
        turn, tilt = np.radians(data["view"])
        back = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
        camera = self.server.initial_camera
        camera.near, camera.far = 0.02 * size, 100.0 * size
        camera.look_at, camera.position = tuple(middle), tuple(middle + AWAY * size * back)

    def _parts(self, data: Json) -> list[tuple[str, Any]]:
        """Draw the surfaces; return the hand's links with their names, other parts without."""
        found = []
        for i, part in enumerate(data["parts"]):
            group = part["group"]
            handle = self.server.scene.add_mesh_simple(
                f"/{group}/{i}",
                vertices=unpacked(part["positions"], "<f4").reshape(-1, 3),
                faces=unpacked(part["faces"], "<u4" if part["wide"] else "<u2").reshape(-1, 3),
                color=rgb("finger" if group == "tip" else group),
                opacity=GLASS.get(group),
            )
            found.append((part["name"] if group in ("link", "tip") else "", handle))
        return found

    def _contacts(self, data: Json) -> list[Any]:
        """Draw the contacts with their numbers; return free fingertips."""
        tips, add = [], self.server.scene
        for i, contact in enumerate(data["contacts"]):
            at, inward = np.array(contact["at"]), np.array(contact["inward"])
            vertices, faces = disc(at - OVER * data["size"] * inward, inward, data["lengths"]["disc"])
            add.add_mesh_simple(f"/contact/{i}", vertices, faces, color=rgb("finger"), side="double")
            add.add_label(f"/contact/{i}/number", str(i), position=tuple(at - 0.2 * data["size"] * inward))
            if contact["tip"] > 0.0:
                centre = tuple(at - contact["tip"] * inward)
                tips.append(
                    add.add_icosphere(f"/hand/{i}", contact["tip"], rgb("finger"), opacity=FREE_TIP, position=centre)
                )
        return tips


def unpacked(text: str, kind: str) -> FloatArray:
    """Return the numbers of packed surface data (``report.scene.surfaces.packed``)."""
    return np.asarray(np.frombuffer(base64.b64decode(text), kind))


def rgb(role: str) -> tuple[int, int, int]:
    """Return a colour of the pages as red, green and blue, from 0 to 255."""
    red, green, blue = bytes.fromhex(COLOURS[role].removeprefix("#"))
    return red, green, blue


def disc(at: FloatArray, normal: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return vertices (n, 3) and triangles (m, 3) of a flat disc."""
    first = np.linalg.svd(normal[None])[2][1]
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
    ring = at + radius * (np.cos(turn) * first + np.sin(turn) * np.cross(normal, first))
    around = np.arange(1, SIDES + 1)
    faces = np.column_stack([np.zeros(SIDES, dtype=int), around, np.roll(around, -1)])
    return np.vstack([at, ring]), faces

"""Start of the interactive viewer on this computer, or a message why not."""

from __future__ import annotations

import contextlib
import io
import socket
import sys
import threading
from dataclasses import replace
from types import ModuleType

from nlpgrasp.common.extras.viser import import_viser
from nlpgrasp.common.shown.face import browsed, has_display
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.hands.base import Hand
from nlpgrasp.report.live.viewer import Viewer
from nlpgrasp.report.live.way import own_hand
from nlpgrasp.report.scene.scene import drawn_body
from nlpgrasp.solution.solution import GraspSolution

HOST = "127.0.0.1"
LARGEST_PORT = 65535
_viewers: dict[int, Viewer] = {}  # by port: a new grasp replaces the previous one


def show_live(solution: GraspSolution, port: int | None = None, hand: Hand | None = None) -> str | None:
    """Show a grasp in the local viewer, and return its address; a script waits until Ctrl-C.

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
    own_hand(solution, hand)
    solution = replace(solution, drawing=solution.drawn())
    if solution.grasp is None or drawn_body(solution) is None:
        return None
    if port is None and not has_display():
        _instead("there is no display. show(port=8080) serves the page with sliders to a browser elsewhere")
        return None
    try:
        viser = import_viser("a view with sliders")
    except MissingExtraError as error:
        _instead(str(error))
        return None
    viewer = served(viser, solution, port, hand)
    if viewer is None:
        _instead(f"port {port} is taken")
        return None
    if not (has_display() and browsed(viewer.address)) and port is None:
        stop(viewer.port)
        return None
    sys.stdout.write(f"The grasp is shown at {viewer.address}\n")
    _wait(viewer.port)
    return viewer.address


def served(
    viser: ModuleType, solution: GraspSolution, port: int | None = None, hand: Hand | None = None
) -> Viewer | None:
    """Return the viewer of a grasp at a port, a free one for None; None where another program has the port."""
    chosen = next(iter(_viewers), None) if port is None else port
    if chosen not in _viewers:
        chosen = _free(0 if port is None else port)
        if chosen is None:
            return None
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
            viewer = Viewer(viser, HOST, chosen)
        if viewer.port != chosen:  # taken in the meantime
            viewer.stop()
            return None
        _viewers[chosen] = viewer
    _viewers[chosen].show(solution, hand)
    return _viewers[chosen]


def stop(port: int) -> None:
    """Stop the viewer at a port."""
    with contextlib.redirect_stdout(io.StringIO()):
        _viewers.pop(port).stop()


def _free(port: int) -> int | None:
    """Return the port, or any free one for 0; None where it is taken."""
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


def _instead(why: str) -> None:
    sys.stdout.write(f"The report is written to a file instead: {why}\n")

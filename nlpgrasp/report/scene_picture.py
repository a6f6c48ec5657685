"""Picture of a page's scene, drawn by a browser without a window."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np

from nlpgrasp.report.grasp_scene import solution_scene
from nlpgrasp.report.page_builder import Heading, scene_html, scene_page, scene_section
from nlpgrasp.report.task_wrenches import choose_wrenches
from nlpgrasp.solution.solution import GraspSolution

# commands of browsers that draw a page into a file, in the order in which they are tried
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
WIDTH, HEIGHT = 1200, 900  # pixels
TIME_LIMIT = 60.0  # seconds
FLAGS = (
    "--headless=new",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",  # draws without a graphics card
    "--enable-unsafe-swiftshader",
    "--virtual-time-budget=2000",
    f"--window-size={WIDTH},{HEIGHT}",
)
STYLE = "<style>.scene { border-radius: 0; height: 100vh; inset: 0; position: fixed; width: 100vw; }</style>"
# without WebGL the picture is blank, which is noticed
SCRIPT = "<script>if (!renderer.gl) document.body.remove();</script>"


def find_browser() -> str | None:
    """Return the path of a browser that can draw a scene, or None if there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def photograph_scene(solution: GraspSolution, browser: str) -> bytes | None:
    """Return the scene of a solution's page as a browser draws it, PNG, or None if the browser fails.

    Parameters
    ----------
    solution : GraspSolution
    browser : str
        Path of its program.
    """
    page = _picture_page(solution)
    if page is None:
        return None
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-", ignore_cleanup_errors=True) as folder:
        file, picture = Path(folder) / "scene.html", Path(folder) / "scene.png"
        file.write_text(page, encoding="utf-8")
        is_root = getattr(os, "geteuid", lambda: 1)() == 0  # browsers refuse their sandbox to root
        more = [f"--user-data-dir={folder}/profile", f"--screenshot={picture}", *(["--no-sandbox"] if is_root else [])]
        command = [browser, *FLAGS, *more, file.as_uri()]
        try:
            subprocess.run(command, capture_output=True, timeout=TIME_LIMIT, check=True)  # noqa: S603
            content = picture.read_bytes()
        except (OSError, subprocess.SubprocessError):
            return None
    return None if _is_blank(content) else content


def _picture_page(solution: GraspSolution) -> str | None:
    """Return a page that the scene of a solution fills; None if there is nothing to draw."""
    solution = replace(solution, drawing=solution.drawn())
    chosen = choose_wrenches(solution)
    scene = solution_scene(solution, chosen)
    if scene is None:
        return None
    data = {"scenes": [scene], "labels": [wrench.label for wrench in chosen], "fingers": []}
    section = scene_section(Heading(solution.name, ""), [scene_html("The grasp", [])], data)
    return scene_page(solution.name, [section, STYLE]).replace("</body>", f"{SCRIPT}</body>")


def _is_blank(picture: bytes) -> bool:
    """Return whether a PNG picture is of one colour."""
    from matplotlib.image import imread

    pixels = imread(BytesIO(picture), format="png")
    return bool(np.all(pixels == pixels[0, 0]))

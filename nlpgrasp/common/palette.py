"""Colour palette of pages, pictures and 3D scenes, colour-blind safe (Okabe, Ito)."""

from __future__ import annotations

COLOURS = {
    "body": "#9AA5B1",
    "link": "#C8B49A",
    "finger": "#0072B2",
    "normal": "#56B4E9",
    "cone": "#56B4E9",
    "force": "#D55E00",
    "task": "#009E73",
    "warning": "#CC3311",
    "gap": "#E69F00",
    "obstacle": "#B58A8A",
    "table": "#8C8577",
    "x": "#C8102E",
    "y": "#5B8A00",
    "z": "#3B5BDB",
}
DARK = COLOURS | {
    "body": "#A9B6C4",
    "finger": "#56B4E9",
    "normal": "#9AD2F5",
    "cone": "#9AD2F5",
    "force": "#F0803C",
    "task": "#2FC49B",
    "warning": "#FF6B52",
    "gap": "#F0B73A",
    "obstacle": "#C79A9A",
    "table": "#9A9384",
    "x": "#FF6B6B",
    "y": "#A3CF4E",
    "z": "#8FA8FF",
}
"""The same, on a dark ground."""


def css_variables(colours: dict[str, str]) -> str:
    """Return colours as CSS declarations, such as ``--body: #9AA5B1``."""
    return " ".join(f"--{name}: {value};" for name, value in colours.items())

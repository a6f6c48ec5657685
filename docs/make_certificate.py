"""Draw docs/pictures/certificate.svg, both proofs of an interval of mu in two dimensions.

Run ``python docs/make_certificate.py``. The grasp is planar, of three contacts with friction; the picture is the
projection of wrench space onto forces.
"""

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

import nlpgrasp as ng
from nlpgrasp.quality.wrench_set import WrenchSet

WIDTH, HEIGHT, SCALE = 800, 360, 130.0
BLUE, GREEN, BROWN, GREY = "#0072B2", "#00795A", "#8A4B08", "#5B6773"
FONT = 'font-family="system-ui, sans-serif" font-size="15"'


def drawn() -> str:
    """Return the picture as SVG text."""
    angles = np.array([0.2, 2.3, 4.4])
    normals = -np.stack([np.cos(angles), np.sin(angles)], axis=1)
    wrenches = WrenchSet.of(ng.Grasp(-normals, normals, ng.FrictionContact(0.5)))
    task = np.diag([1.0, 0.62])  # semi-axes of the task, as rows

    def support(turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        y = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        values, points = wrenches.support(np.column_stack([y, np.zeros(len(y))]))
        return y, values, points[:, :2]

    y, values, outline = support(np.linspace(0.0, 2.0 * np.pi, 721))
    ratios = values / np.linalg.norm(y @ task, axis=1)
    worst = int(np.argmin(ratios))
    vertices = support(np.linspace(0.1, 2.0 * np.pi + 0.1, 12)[:-1])[2]
    hull = ConvexHull(vertices)
    heights = -hull.equations[:, 2] / np.linalg.norm(hull.equations[:, :2] @ task, axis=1)
    least = int(np.argmin(heights))
    circle = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 181)), np.sin(np.linspace(0.0, 2.0 * np.pi, 181))], axis=1)
    touching, along = outline[worst], np.array([-y[worst, 1], y[worst, 0]])
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        'aria-label="A polygon of exerted wrenches holds the task: a lower bound; a half-plane: an upper one">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="12" fill="#F7F8FA"/>',
        path(outline, GREY, fill="#E4E7EB", width=2),
        path(vertices[hull.vertices], BLUE, width=1.5),
        *(path(np.stack([np.zeros(2), v]), BLUE, width=0.6) for v in vertices),
        path(vertices[hull.simplices[least]], BLUE, width=5),
        path(heights[least] * circle @ task, GREEN, fill="#00795A33", width=2),
        path(ratios[worst] * circle @ task, BROWN, width=1.5, dash="6 4"),
        path(np.stack([touching - 0.75 * along, touching + 0.75 * along]), BROWN, width=3),
    ]
    texts = [
        (GREY, "W: the wrenches that unit forces exert"),
        (BLUE, "polytope of exerted wrenches, cut into cells;"),
        (BLUE, "bold: the cell nearest to the task"),
        (GREEN, f"lower · task: the cells hold it, lower = {heights[least]:.3f}"),
        (BROWN, "upper · task: it touches a half-space around W,"),
        (BROWN, f"which multipliers prove, upper = {ratios[worst]:.3f}"),
    ]
    parts += [f'<text x="420" y="{95 + 34 * i}" fill="{c}" {FONT}>{t}</text>' for i, (c, t) in enumerate(texts)]
    return "\n".join([*parts, "</svg>\n"])


def path(points: np.ndarray, colour: str, fill: str = "none", width: float = 1.0, dash: str = "") -> str:
    """Return a line through points, closed if there are more than two."""
    x, y = 205.0 + SCALE * points[:, 0], 185.0 - SCALE * points[:, 1]
    steps = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    closed = "Z" if len(points) > 2 else ""
    return f'<path d="M{steps}{closed}" fill="{fill}" stroke="{colour}" stroke-width="{width}"{dashes}/>'


if __name__ == "__main__":
    (Path(__file__).resolve().parent / "pictures" / "certificate.svg").write_text(drawn(), encoding="utf-8")

"""Draw docs/pictures/layers.svg from the table of layers in docs/architecture.md: ``python docs/make_layers.py``."""

import re
from html import escape
from pathlib import Path

DOCS = Path(__file__).resolve().parent
WIDTH, ROW, LEFT, ROOMS, GAP = 1180, 46, 24, 530, 8
HUES = ("#0072B2", "#00795A", "#5B6773", "#8A4B08")  # asks and shows, searches, is data, proves: colour-blind safe
KIND = {"cli": 0, "faces": 0, "studies": 1, "solve": 1, "nlp": 1, "quality": 3, "verify": 3, "best": 3}
FACES = ("report", "experiments", "interop", "simulation")


def layers() -> list[tuple[list[str], str]]:
    """Return the rooms of each layer and what they are for, from the top down."""
    block = re.search(r"```text\n(.*?)```", (DOCS / "architecture.md").read_text(encoding="utf-8"), re.DOTALL)
    if block is None:
        raise SystemExit("docs/architecture.md: no table of layers in a text block")
    rows = [re.split(r" {3,}", line.strip(), maxsplit=1) for line in block[1].splitlines() if line.strip()]
    return [(names.split(), words) for names, words in rows]


def colour(room: str) -> str:
    """Return the colour of a room's box."""
    return HUES[KIND.get("faces" if room in FACES else room, 2)]


def drawn(rows: list[tuple[list[str], str]]) -> str:
    """Return the picture as SVG text."""
    height = ROW * len(rows) + 40
    font = 'font-family="system-ui, sans-serif"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-label="Layers of the package: imports point down only">',
        f'<rect width="{WIDTH}" height="{height}" rx="12" fill="#F7F8FA"/>',
    ]
    for i, (names, words) in enumerate(rows):
        y = 20 + i * ROW
        wide = (ROOMS - GAP * (len(names) - 1)) / len(names)
        for j, name in enumerate(names):
            x = LEFT + j * (wide + GAP)
            parts.append(f'<rect x="{x:.0f}" y="{y}" width="{wide:.0f}" height="34" rx="6" fill="{colour(name)}"/>')
            parts.append(
                f'<text x="{x + wide / 2:.0f}" y="{y + 22}" text-anchor="middle" fill="#fff" font-size="14" '
                f'font-weight="600" {font}>{escape(name)}</text>'
            )
        parts.append(
            f'<text x="{LEFT + ROOMS + 40}" y="{y + 22}" fill="#333B44" font-size="14" {font}>{escape(words)}</text>'
        )
    x, top, bottom = LEFT + ROOMS + 18, 26, height - 26
    parts.append(f'<path d="M{x} {top}V{bottom}m-5 -8l5 8l5 -8" fill="none" stroke="#D55E00" stroke-width="2"/>')
    return "\n".join([*parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    target = DOCS / "pictures" / "layers.svg"
    target.write_text(drawn(layers()), encoding="utf-8")
    print(f"written to {target.relative_to(DOCS.parent)}")

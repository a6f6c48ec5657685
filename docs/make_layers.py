"""Draw the pictures of docs/architecture.md from its tables: ``python docs/make_layers.py``."""

import re
from html import escape
from pathlib import Path

DOCS = Path(__file__).resolve().parent
WIDTH, ROW, LEFT, ROOMS, GAP = 1180, 46, 24, 530, 8
HUES = ("#0072B2", "#00795A", "#5B6773", "#8A4B08")  # asks and shows, searches, is data, proves: colour-blind safe
KIND = {"cli": 0, "faces": 0} | dict.fromkeys(("studies", "pipeline", "analysis", "optimize", "nlp", "motion"), 1)
KIND |= {"quality": 3, "verify": 3, "global_bound": 3}
STAGES = {
    "pipeline": ("How a grasp is found", "Stages of a solve"),
    "hand_search": ("How a hand's grasp is found", "Stages of a hand's start"),
}
FACES = ("sets", "report", "experiments", "interop", "simulation")


def layers() -> list[tuple[list[str], str]]:
    """Return the rooms of each layer and what they are for, from the top down."""
    return [(names.split(), words) for names, words in table("Layers", 2)]


def stages(heading: str) -> list[tuple[str, str, str]]:
    """Return name, file and purpose of each stage in the table below a heading."""
    return [(name, file, words) for name, file, words in table(heading, 3)]


def table(heading: str, columns: int) -> list[list[str]]:
    """Return the rows of the text block below a heading, split at wide gaps."""
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    block = re.search(rf"^## {heading}$.*?```text\n(.*?)```", page, re.DOTALL | re.MULTILINE)
    if block is None:
        raise SystemExit(f"docs/architecture.md: no table in a text block below {heading}")
    return [re.split(r" {3,}", line.strip(), maxsplit=columns - 1) for line in block[1].splitlines() if line.strip()]


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


def drawn_stages(rows: list[tuple[str, str, str]], label: str) -> str:
    """Return the picture of stages as SVG text: one box and one file each, and what flows back."""
    box, step = 150, 74
    height = step * len(rows) + 20
    font = 'font-family="system-ui, sans-serif"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-label="{label}, each in one file">',
        f'<rect width="{WIDTH}" height="{height}" rx="12" fill="#F7F8FA"/>',
    ]
    left = 150
    for i, (name, file, words) in enumerate(rows):
        y = 18 + i * step
        hue = colour(file.split("/")[0])
        parts += [
            f'<rect x="{left}" y="{y}" width="{box}" height="44" rx="6" fill="{hue}"/>',
            f'<text x="{left + box / 2:.0f}" y="{y + 28}" text-anchor="middle" fill="#fff" font-size="16" '
            f'font-weight="600" {font}>{escape(name)}</text>',
            f'<text x="{left + box + 30}" y="{y + 19}" fill="#333B44" font-size="15" {font}>{escape(words)}</text>',
            f'<text x="{left + box + 30}" y="{y + 39}" fill="#5B6773" font-size="13" '
            f'font-family="ui-monospace, monospace">nlpgrasp/{escape(file)}</text>',
        ]
        if i + 1 < len(rows):
            down = f"M{left + box // 2} {y + 46}v{step - 50}m-5 -8l5 8l5 -8"
            parts.append(f'<path d="{down}" fill="none" stroke="#D55E00" stroke-width="2"/>')
    places = [i for i, (name, *_) in enumerate(rows) if name in ("propose", "bound")]
    if len(places) == 2:
        above, below = (18 + i * step + 22 for i in places)
        back = f"M{left} {below}H{left - 40}V{above}h34m-8 -5l8 5l-8 5"
        parts += [
            f'<path d="{back}" fill="none" stroke="#D55E00" stroke-width="2" stroke-dasharray="6 4"/>',
            f'<text x="{left - 50}" y="{(above + below) / 2 - 4:.0f}" text-anchor="end" fill="#333B44" font-size="13" '
            f"{font}>relaxed</text>",
            f'<text x="{left - 50}" y="{(above + below) / 2 + 14:.0f}" text-anchor="end" fill="#333B44" font-size="13" '
            f"{font}>placements</text>",
        ]
    return "\n".join([*parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    pictures = {"layers": drawn(layers())} | {n: drawn_stages(stages(h), label) for n, (h, label) in STAGES.items()}
    for name, picture in pictures.items():
        target = DOCS / "pictures" / f"{name}.svg"
        target.write_text(picture, encoding="utf-8")
        print(f"written to {target.relative_to(DOCS.parent)}")

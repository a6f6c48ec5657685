"""Solve README's example and write its picture, the scene of its report as a browser draws it.

Run by ``make picture``, from the checkout's root; needs Debian's chromium (``make browser``).
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

import nlpgrasp as ng
from nlpgrasp.report import write_report

DOCS = Path(__file__).resolve().parent
WIDTH, HEIGHT = 1200, 620
STYLE = ".panel{{display:none!important}}.scene{{width:{}px!important;height:{}px!important;border-radius:0!important}}"


def example() -> ng.GraspSolution:
    """Return what the script in README finds."""
    script = re.search(r"```python\n(.*?)solution = ", (DOCS.parent / "README.md").read_text(), re.DOTALL)
    if script is None:
        raise SystemExit("README.md holds no script")
    names: dict[str, ng.GraspProblem] = {}
    exec(script.group(1), names)  # noqa: S102
    return ng.solve(names["problem"], starts=4)


def photographed(page: Path, picture: Path, width: int = WIDTH, height: int = HEIGHT) -> None:
    """Write what a browser draws of a report's scene, at a size in pixels."""
    options = webdriver.ChromeOptions()
    for flag in (
        "--headless=new",
        "--no-sandbox",
        f"--window-size={width + 200},{height + 400}",
        "--use-angle=swiftshader",
    ):
        options.add_argument(flag)
    options.add_argument("--enable-unsafe-swiftshader")
    with webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver")) as browser:
        browser.get(page.as_uri())
        style = STYLE.format(width, height)
        browser.execute_script("document.head.insertAdjacentHTML('beforeend', `<style>${arguments[0]}</style>`)", style)
        browser.execute_async_script(
            "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(arguments[0], 300)))"
        )
        browser.find_element("css selector", ".scene").screenshot(str(picture))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        photographed(write_report({"box": example()}, Path(folder) / "box.html"), DOCS / "pictures" / "box.png")

"""Reports: seconds to make one of a mesh grasp, its size, and until it can be used in headless chromium."""

import shutil
import statistics
import tempfile
import time
from pathlib import Path

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING
from nlpgrasp.report import write_report

NAMES = ("ycb_012_strawberry.stl", "ycb_048_hammer.stl", "ycb_010_potted_meat_can.stl")
REPEATS = 5


def run():
    if not MESHES.is_dir():
        print(MISSING)
        return
    for name in NAMES:
        body = ng.Mesh.load(MESHES / name)
        task = ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3])
        solution = ng.solve(ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task, name=name), starts=1)
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            page = write_report({name: solution}, Path(folder) / "report.html")
            seconds, size = time.perf_counter() - begun, page.stat().st_size / 1e6
            shown = statistics.median(ready(page) for _ in range(REPEATS)) if shutil.which("chromedriver") else None
        usable = "no chromedriver" if shown is None else f"usable after {1e-3 * shown:.2f} s (aim 2)"
        print(f"{name}: made in {seconds:.2f} s (aim 3), {size:.1f} MB (aim 6), {usable}")


def ready(page):
    """Return the milliseconds until the scene is drawn, in a browser that has just been started."""
    from selenium import webdriver
    from selenium.webdriver.support.ui import WebDriverWait

    options = webdriver.ChromeOptions()
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "enable-unsafe-swiftshader"):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        driver.get(page.as_uri())
        script = "return Number(document.querySelector('.scene').dataset.ready)"
        return WebDriverWait(driver, 60).until(lambda d: d.execute_script(script))
    finally:
        driver.quit()

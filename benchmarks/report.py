"""Reports of mesh grasps: time to write, file size, and time to draw in headless Chromium."""

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
            start_time = time.perf_counter()
            page = write_report({name: solution}, Path(folder) / "report.html")
            seconds, size = time.perf_counter() - start_time, page.stat().st_size / 1e6
            ready_milliseconds = (
                statistics.median(ready(page) for _ in range(REPEATS)) if shutil.which("chromedriver") else None
            )
        usable_text = (
            "no chromedriver"
            if ready_milliseconds is None
            else f"usable after {1e-3 * ready_milliseconds:.2f} s (aim 2)"
        )
        print(f"{name}: made in {seconds:.2f} s (aim 3), {size:.1f} MB (aim 6), {usable_text}")


def ready(page):
    """Return the milliseconds until the scene is drawn in a new browser."""
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

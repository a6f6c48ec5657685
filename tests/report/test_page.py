"""The report in a real browser: it draws, the slider moves the arrows, nothing goes wrong, nothing is too wide."""

import json
import re
import shutil
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.report import write_pictures, write_report

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="needs Debian's chromium and chromium-driver: make browser"
)


@pytest.fixture(scope="module")
def planar():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0])
    return ng.solve(
        ng.GraspProblem(
            square, [ng.FrictionContact(0.5)] * 2, task, constraints=[ng.Table(-0.999)], name="square </b>"
        ),
        starts=2,
        options=ng.SolveOptions(workers=1),
    )


@pytest.fixture(scope="module")
def spatial():
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.SoftContact(0.6, 0.01)] * 3,
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        name="box",
    )
    return ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))


@pytest.fixture(scope="module")
def page(planar, spatial, tmp_path_factory):
    return write_report({"a.json": planar, "b.json": spatial}, tmp_path_factory.mktemp("report") / "both.html")


@pytest.fixture(scope="module")
def browser():
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "enable-unsafe-swiftshader"):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    driver.set_window_size(1600, 1000)
    yield driver
    driver.quit()


def opened(browser, page):
    """Open the page, wait until all scenes are drawn and return the milliseconds that took in the browser."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get(page.as_uri())
    script = "return [...document.querySelectorAll('.scene')].map(s => Number(s.dataset.ready))"
    return max(WebDriverWait(browser, 60).until(lambda b: all(v := b.execute_script(script)) and v))


@needs_browser
def test_it_draws_without_an_error(browser, page):
    opened(browser, page)
    assert browser.execute_script("return document.querySelectorAll('.scene canvas').length") >= 2
    problems = [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "ERROR")]
    assert problems == []


@needs_browser
def test_the_body_shows_where_a_contact_is_worth_most(browser, page):
    """By keyboard: the triangles get colours of their own, and lose them again."""
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    section = browser.find_elements("css selector", "section[data-grasp]")[1]
    switch = section.find_element("css selector", "input[data-worth]")
    colours = "return (arguments[0].querySelector('.scene').data[0].facecolor || []).length"
    assert browser.execute_script(colours, section) == 0
    switch.send_keys(Keys.SPACE)
    assert browser.execute_script(colours, section) > 500
    switch.send_keys(Keys.SPACE)
    assert browser.execute_script(colours, section) == 0


@needs_browser
def test_the_slider_moves_the_arrows_and_says_so(browser, page):
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    section = browser.find_elements("css selector", "section[data-grasp]")[1]
    slider = section.find_element("css selector", "input[type=range]")
    shafts = "const d = arguments[0].querySelector('.scene').data; return [...d[d.length - 2].x]"
    before, words = browser.execute_script(shafts, section), section.find_element("css selector", "output").text
    slider.send_keys(Keys.ARROW_RIGHT)  # by keyboard alone
    after = browser.execute_script(shafts, section)
    assert before != after
    assert section.find_element("css selector", "output").text != words
    assert "task wrench 1" in slider.get_attribute("aria-valuetext")
    data = json.loads(section.find_element("css selector", "script").get_attribute("textContent"))
    assert after == data["arrows"][1][0]["x"]


@needs_browser
@pytest.mark.parametrize("width", [400, 1600])
def test_it_fits_narrow_and_wide_windows(browser, page, width):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    )
    opened(browser, page)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    texts = "[...document.querySelectorAll('p, td, output, label')]"
    assert (
        browser.execute_script(f"return Math.min(...{texts}.map(e => parseFloat(getComputedStyle(e).fontSize)))") >= 12
    )
    drawn, stage = (
        browser.execute_script(f"return document.querySelector('{which}').getBoundingClientRect().width")
        for which in (".scene canvas", ".scene")
    )
    assert abs(drawn - stage) <= 3
    assert stage >= min(0.85 * width, 1100)


@needs_browser
def test_everything_has_a_name_for_screen_readers(browser, page):
    opened(browser, page)
    unnamed = browser.execute_script(
        "return [...document.querySelectorAll('section, input, [role=img]')].filter("
        "e => !e.getAttribute('aria-label') && !e.getAttribute('aria-labelledby') && !(e.labels || []).length).length"
    )
    assert unnamed == 0
    assert browser.execute_script("return document.documentElement.lang") == "en"
    assert browser.execute_script("return document.querySelectorAll('h1').length") == 1


def test_the_page_needs_no_network(page):
    text = page.read_text()
    bundle = files("nlpgrasp.report").joinpath("vendor", "plotly-gl3d.min.js").read_text(encoding="utf-8")
    assert text.count(bundle[:200]) == 1  # once for both grasps
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # without plotly, which holds addresses of maps
    assert not re.findall(r"(?:src|href)=\"(?!data:)", own)
    assert "square &lt;/b&gt;" in own
    assert "square </b>" not in own


def test_the_numbers_are_those_of_the_file(planar, page):
    text = page.read_text()
    assert f"mu-tilde is certified in {planar.mu}" in text
    data = json.loads(re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)[0])
    hardest = data["labels"][0]
    assert hardest.startswith("hardest wrench: f_")
    assert len(data["labels"]) == len(data["arrows"]) == len(data["fingers"]) >= 3
    assert "different things" in text  # the two tasks differ


def test_arrows_end_at_the_contacts_and_balance_the_wrench(spatial):
    from nlpgrasp.report.solution.chosen_wrenches import chosen_wrenches
    from nlpgrasp.report.solution.scene import scene

    chosen = chosen_wrenches(spatial)
    traces, arrows = scene(spatial, chosen)
    grasp = spatial.grasp
    for one, (shafts, _) in zip(chosen, arrows, strict=True):
        np.testing.assert_allclose(one.forces.sum(axis=0), one.wrench[:3], atol=1e-6)
        tails, necks = (np.array([shafts[a][i::3] for a in "xyz"]).T for i in (0, 1))
        along = necks - tails
        loaded = np.linalg.norm(along, axis=1) > 1e-4
        straight = np.cross(along[loaded], one.forces[loaded])
        assert np.max(np.abs(straight)) < 1e-2 * np.max(np.abs(along)) * np.max(np.abs(one.forces))
        beyond = np.cross(grasp.points[loaded] - tails[loaded], along[loaded])
        assert np.max(np.abs(beyond)) < 1e-4 * 0.05
    assert [t["name"] for t in traces[-2:]] == ["finger forces", "arrow heads"]


def test_shadows_are_convex_and_hold_the_task(spatial, planar):
    from scipy.spatial import ConvexHull

    from nlpgrasp.report.solution.wrench_space import shadows

    for solution in (spatial, planar):
        for shadow in shadows(solution):
            hull = ConvexHull(shadow.grasp)
            x, y = (shadow.grasp - shadow.grasp.mean(axis=0)).T
            area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
            assert area == np.clip(area, 0.999 * hull.volume, 1.001 * hull.volume)
            size = np.ptp(shadow.grasp, axis=0)
            inside = hull.equations[:, :2] @ shadow.task.T + hull.equations[:, 2:]
            assert np.max(inside) <= 2e-3 * np.max(size)


def test_a_solution_without_a_grasp_has_a_page(tmp_path):
    problem = ng.GraspProblem(ng.Sphere(1.0), [ng.PointContact()] * 2, ng.TaskEllipsoid([1.0] * 6), name="none")
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    text = write_report({"none.json": solution}, tmp_path / "none.html").read_text()
    assert "No grasp found" in text
    assert 'class="status failed"' in text


@pytest.mark.parametrize("given", [{}, {"a": 3}])
def test_other_things_are_refused(given, tmp_path):
    with pytest.raises(InputError, match="solution"):
        write_report(given, tmp_path / "x.html")


def test_a_page_that_cannot_be_written_is_refused(planar):
    with pytest.raises(InputError, match="a folder that exists"):
        write_report({"a": planar}, Path("/none/x.html"))


def test_pictures_need_no_browser(spatial, tmp_path):
    import matplotlib.image

    paths = write_pictures(spatial, tmp_path / "box")
    assert [p.name for p in paths] == ["box-grasp.png", "box-wrenches.png", "box-convergence.png"]
    grasp = matplotlib.image.imread(paths[0])[..., :3]
    force = np.array([0xC2, 0x41, 0x0C]) / 255.0
    assert np.sum(np.all(np.abs(grasp - force) < 0.02, axis=-1)) > 100  # the arrows are seen
    wrenches = matplotlib.image.imread(paths[1])[..., :3]
    limit = np.array([0xD6, 0x27, 0x28]) / 255.0
    assert np.sum(np.all(np.abs(wrenches - limit) < 0.02, axis=-1)) > 50

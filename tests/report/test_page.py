"""Solution report in a browser: drawing, slider, errors, width."""

import base64
import json
import re
import shutil
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.formatting import format_interval
from nlpgrasp.common.optional_packages import write_figure
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.errors import InputError
from nlpgrasp.report import scene_picture, write_pictures, write_report
from nlpgrasp.report.pictures import draw_grasp, write_noted_pictures
from tests.held_block import held_block
from tests.images import colours
from tests.once import WITHOUT_VOLUME, solve_once

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="needs Debian's chromium and chromium-driver: make browser"
)


@pytest.fixture(scope="module")
def planar():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0])
    return solve_once(
        ng.GraspProblem(
            square, [ng.FrictionContact(0.5)] * 2, task, constraints=[ng.Table(-0.999)], name="square </b>"
        ),
        starts=2,
    )


@pytest.fixture(scope="module")
def spatial():
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.SoftContact(0.6, 0.01)] * 3,
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        name="box",
    )
    return solve_once(problem, starts=1, options=WITHOUT_VOLUME)


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
    driver.set_window_size(1000, 700)
    yield driver
    driver.quit()


def opened(browser, page):
    """Open the page, wait until all scenes are drawn and return the milliseconds that took in the browser."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get(page.as_uri())
    script = "return [...document.querySelectorAll('.scene')].map(s => Number(s.dataset.ready))"
    return max(WebDriverWait(browser, 60).until(lambda b: all(v := b.execute_script(script)) and v))


def drawn(browser, index=0):
    """Colours of a scene as it is seen, (height, width, 4), 0 to 255: red, green, blue, opacity."""
    script = """
        const canvas = document.querySelectorAll('.scene canvas')[arguments[0]];
        const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        let text = '';
        for (let i = 0; i < data.length; i += 16384)
            text += String.fromCharCode.apply(null, data.subarray(i, i + 16384));
        return [canvas.width, canvas.height, btoa(text)];
    """
    width, height, data = browser.execute_script(script, index)
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4).astype(int)


def orange(pixels):
    """Where the arrows are."""
    red, green, blue = (pixels[..., i] for i in range(3))
    return (red > 150) & (green < 0.65 * red) & (blue < 0.35 * red)


def shown_as(browser, scheme):
    feature = {"name": "prefers-color-scheme", "value": scheme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    frames(browser)


def frames(browser):
    """Wait until the page has been painted twice."""
    browser.execute_script("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@needs_browser
def test_it_draws_without_an_error(browser, page):
    opened(browser, page)
    assert browser.execute_script("return document.querySelectorAll('.scene canvas').length") == 2
    for i in range(2):
        pixels = drawn(browser, i)
        assert np.mean(pixels[..., 3] > 0) > 0.05
        assert np.sum(orange(pixels)) > 100
    problems = [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "ERROR")]
    assert problems == []


@pytest.mark.slow
@needs_browser
def test_every_arrow_is_in_the_picture(browser, page):
    """From all around: the ends of the arrows are inside the canvas, as the viewer projects them."""
    opened(browser, page)
    script = """
        const view = document.querySelectorAll('.scene')[1].view, found = [];
        for (let turn = 0; turn < 6.3; turn += 0.7) {
            [view.turn, view.tilt] = [turn, turn / 4 - 0.5];
            view.draw();
            for (const arrow of view.scene.data.arrows.flat(2)) {
                const [x, y] = view.eye.project(arrow);
                found.push([x / view.element.clientWidth, y / view.element.clientHeight]);
            }
        }
        return found;
    """
    ends = np.array(browser.execute_script(script))
    assert len(ends) > 100
    assert np.min(ends) > 0.03
    assert np.max(ends) < 0.97


@pytest.mark.slow
@needs_browser
def test_the_scene_follows_light_and_dark_as_they_change(browser, page):
    shown_as(browser, "light")
    opened(browser, page)
    ground = "return getComputedStyle(document.documentElement).backgroundColor"
    light, before = drawn(browser, 1), browser.execute_script(ground)
    shown_as(browser, "dark")
    dark, after = drawn(browser, 1), browser.execute_script(ground)
    shown_as(browser, "light")
    assert (before, after) == ("rgb(255, 255, 255)", "rgb(18, 22, 27)")
    assert np.mean(np.abs(light - dark).sum(axis=-1)[light[..., 3] == 255]) > 10  # drawn anew, in the dark's colours
    assert np.mean(dark[light[..., 3] == 255][:, :3]) > np.mean(light[light[..., 3] == 255][:, :3])


@pytest.mark.slow
@needs_browser
def test_switches_change_the_scene_by_keyboard(browser, page):
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    section = browser.find_elements("css selector", "section[data-grasp]")[1]
    before = drawn(browser, 1)
    for name in ("forces", "cones", "normals", "through", "worth"):
        switch = section.find_element("css selector", f"input[data-show={name}]")
        switch.send_keys(Keys.SPACE)
        assert np.mean(np.any(drawn(browser, 1) != before, axis=-1)) > 1e-3, name
        if name == "forces":
            assert np.sum(orange(drawn(browser, 1))) == 0
        switch.send_keys(Keys.SPACE)
        assert np.array_equal(drawn(browser, 1), before), name


@needs_browser
def test_the_slider_moves_the_arrows_and_says_so(browser, page):
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    section = browser.find_elements("css selector", "section[data-grasp]")[1]
    slider = section.find_element("css selector", "input[type=range]")
    before, words = drawn(browser, 1), section.find_element("css selector", "output").text
    slider.send_keys(Keys.ARROW_RIGHT)  # by keyboard alone
    assert np.any(orange(drawn(browser, 1)) != orange(before))
    assert section.find_element("css selector", "output").text != words
    assert slider.get_attribute("aria-valuetext").startswith("End 1: ")
    data = json.loads(
        section.find_element("css selector", 'script[type="application/json"]').get_attribute("textContent")
    )
    texts = [row.get_attribute("textContent") for row in section.find_elements("css selector", ".finger .words")]
    assert texts == [f["words"] for f in data["fingers"][1]]


@pytest.mark.slow
@needs_browser
def test_the_scene_turns_by_mouse_and_keys_and_returns(browser, page):
    from selenium.webdriver.common.keys import Keys

    opened(browser, page)
    scene = browser.find_elements("css selector", ".scene")[1]
    before = drawn(browser, 1)
    scene.send_keys(Keys.ARROW_LEFT)
    frames(browser)
    assert not np.array_equal(drawn(browser, 1), before)
    scene.send_keys("0")
    frames(browser)
    assert np.array_equal(drawn(browser, 1), before)


@pytest.mark.slow
@needs_browser
def test_a_phone_shows_the_scene_first(browser, page):
    metrics = {"width": 400, "height": 860, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    opened(browser, page)
    scene = browser.find_elements("css selector", ".scene")[1]
    top = "return arguments[0].getBoundingClientRect()"
    stage = browser.execute_script(top, scene)
    card = browser.execute_script(top, browser.find_elements("css selector", ".panel")[1])
    section = browser.execute_script(top, browser.find_elements("css selector", "section[data-grasp]")[1])
    assert stage["top"] - section["top"] < 130
    assert card["top"] > stage["bottom"]
    assert card["left"] < stage["left"] + 1  # cards from edge to edge, to be swiped


@pytest.mark.slow
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
    canvas, stage = (
        browser.execute_script(f"return document.querySelector('{which}').getBoundingClientRect().width")
        for which in (".scene canvas", ".scene")
    )
    assert abs(canvas - stage) <= 3
    assert stage >= (0.85 if width < 900 else 0.6) * width


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
    viewer = files("nlpgrasp.report").joinpath("viewer", "view.js").read_text(encoding="utf-8")
    assert text.count(viewer) == 1  # once for both grasps
    assert not re.findall(r"(?:src|href)=\"(?!data:)|https?://|@import|url\(", text)
    assert page.stat().st_size < 1_000_000
    assert "square &lt;/b&gt;" in text
    assert "square </b>" not in text


def test_the_numbers_are_those_of_the_file(planar, page):
    text = page.read_text()
    lower, upper = format_interval(planar.mu.lower, planar.mu.upper)
    assert f'<p class="value">{lower} to {upper}</p>' in text
    assert f"mu-tilde is certified between {lower} and {upper}" in text
    data = json.loads(re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)[0])
    assert data["labels"][0].startswith("Hardest: ")
    assert len(data["labels"]) == len(data["scenes"][0]["arrows"]) == len(data["fingers"]) >= 3
    assert "different things" in text  # the two tasks differ


def test_no_number_has_needless_digits_or_is_minus_zero(page):
    """Apart from the inputs and the code, which are as they are."""
    text = re.sub(r"<(script|style|pre|svg).*?</\1>|<[^>]*>", " ", page.read_text(), flags=re.DOTALL)
    assert not re.findall(r"[-\N{MINUS SIGN}]0(?:\.0*)?(?![.\d])", text)
    assert not re.findall(r"\d*\.(?!000)\d{6,}", text)
    assert not re.findall(r"\.\d*(?:99999|00000)\d*", text)


def test_arrows_balance_the_wrench(spatial):
    from nlpgrasp.report.task_wrenches import choose_wrenches

    for chosen in choose_wrenches(spatial):
        np.testing.assert_allclose(chosen.forces.sum(axis=0), chosen.wrench[:3], atol=1e-6)


def test_shadows_are_convex_and_hold_the_task(spatial, planar):
    from scipy.spatial import ConvexHull

    from nlpgrasp.report.task_wrenches import solution_projections

    for solution in (spatial, planar):
        for shadow in solution_projections(solution):
            hull = ConvexHull(shadow.grasp)
            x, y = (shadow.grasp - shadow.grasp.mean(axis=0)).T
            area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
            assert area == np.clip(area, 0.999 * hull.volume, 1.001 * hull.volume)
            size = np.ptp(shadow.grasp, axis=0)
            inside = hull.equations[:, :2] @ shadow.task.T + hull.equations[:, 2:]
            assert np.max(inside) <= 2e-3 * np.max(size)


@pytest.mark.slow
def test_a_solution_without_a_grasp_has_a_page(tmp_path):
    problem = ng.GraspProblem(ng.Sphere(1.0), [ng.PointContact()] * 2, ng.TaskEllipsoid([1.0] * 6), name="none")
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    text = write_report({"none.json": solution}, tmp_path / "none.html").read_text()
    assert "No grasp found" in text
    assert 'class="fact bad broad"' in text
    assert '<div class="scene"' in text  # the body all the same


@pytest.mark.parametrize("given", [{}, {"a": 3}])
def test_other_things_are_refused(given, tmp_path):
    with pytest.raises(InputError, match="solution"):
        write_report(given, tmp_path / "x.html")


def test_a_page_that_cannot_be_written_is_refused(planar):
    with pytest.raises(InputError, match="a folder that exists"):
        write_report({"a": planar}, Path("/none/x.html"))


def test_a_picture_shows_the_gripper_and_no_edges_of_triangles(tmp_path):
    """Fingers and palm are seen in the colour of links; the faces of a block have one colour each, without lines."""
    held = held_block()
    figure = draw_grasp(held)
    picture = colours(write_figure(figure, tmp_path / "block.png"))
    shades = picture[..., :2] / np.maximum(picture[..., 2:], 1e-9)
    link, body = (np.array([int(COLOURS[name][i : i + 2], 16) for i in (1, 3, 5)]) for name in ("link", "body"))
    seen = {
        name: np.all(np.abs(shades - colour[:2] / colour[2]) < 0.03, axis=-1)
        for name, colour in (("link", link), ("body", body))
    }
    assert seen["link"].mean() > 0.05
    assert seen["body"].mean() > 0.05
    pixels = 255.0 * picture[seen["body"] | seen["link"]]
    shades, counts = np.unique(np.round(pixels).astype(int), axis=0, return_counts=True)
    flat = shades[np.argsort(-counts)[:8]]  # three faces of the block and of the gripper's boxes, by rounding
    distance = np.min(np.max(np.abs(pixels[:, None] - flat), axis=2), axis=1)
    assert np.mean(distance < 5.0) > 0.97


@needs_browser
def test_the_picture_is_the_pages_scene_where_there_is_a_browser(tmp_path, monkeypatch):
    """Contacts have their numbers, links are glass, and nothing of the page around the scene is seen."""
    ((path, note), *_) = write_noted_pictures(held_block(), tmp_path / "block").items()
    assert note == "the page's scene, drawn by chromium"
    picture = colours(path)
    assert picture.shape[:2] == (900, 1200)
    contact = np.array([int(COLOURS["finger"][i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    assert np.sum(np.all(np.abs(picture - contact) < 0.02, axis=-1)) > 100
    assert picture[[0, 0, -1, -1], [0, -1, 0, -1]].min() > 0.9  # light, as pages are read on white paper
    monkeypatch.setattr(scene_picture, "FLAGS", (*scene_picture.FLAGS, "--disable-3d-apis"))
    assert scene_picture.photograph_scene(held_block(), BROWSER) is None
    monkeypatch.setattr("shutil.which", lambda name: "/bin/false" if name == "chromium" else None)
    ((path, note), *_) = write_noted_pictures(held_block(), tmp_path / "other").items()
    assert note == "a drawing, as false drew nothing"


def test_pictures_need_no_browser(spatial, tmp_path, monkeypatch):
    import matplotlib.image

    monkeypatch.setattr("nlpgrasp.report.pictures.find_browser", lambda: None)
    assert "a drawing, as no Chromium" in next(iter(write_noted_pictures(spatial, tmp_path / "box").values()))
    paths = write_pictures(spatial, tmp_path / "box")
    assert [p.name for p in paths] == ["box-grasp.png", "box-wrenches.png", "box-convergence.png"]
    grasp = matplotlib.image.imread(paths[0])[..., :3]
    force = np.array([0xD5, 0x5E, 0x00]) / 255.0
    assert np.sum(np.all(np.abs(grasp - force) < 0.02, axis=-1)) > 100  # the arrows are seen
    wrenches = matplotlib.image.imread(paths[1])[..., :3]
    limit = np.array([0xCC, 0x33, 0x11]) / 255.0
    assert np.sum(np.all(np.abs(wrenches - limit) < 0.02, axis=-1)) > 50

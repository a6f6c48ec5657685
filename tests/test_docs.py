"""The documentation: every code block runs, the site builds without a warning, no link is broken."""

import fcntl
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import nlpgrasp as ng

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
SLOW = (
    "index",  # README runs the same
    "hands",
    "experiments",
    "many_grasps",
    "interop",
    "simulation",
    "tasks",
    "how_to_choose",
    "choosing_contacts",
    "my_solve_failed",
    "getting_started",
    "see_it",
    "my_mesh_my_hand",
    "architecture",
    "cli",
    "certified_bounds",
    "verification",
    "task_libraries",
    "gripper_and_part",
    "data_sets",
    "how_long",
    "program",
    "grasp_metrics",
    "05_delta",
    "08_mu",
    "10_optimal_grasp",
    "measures",
    "own_kinds",
)
BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
BLOCK = re.compile(r"```(python|sh)\n(.*?)```", re.DOTALL)
FILE = re.compile(r'```python title="(.*?)"\n(.*?)```', re.DOTALL)
SHELL = "\nimport subprocess\nsubprocess.run(['bash', '-euo', 'pipefail', '-c', {!r}], check=True)\n"
RUN = [
    pytest.param(p, marks=[pytest.mark.slow] if p.stem in SLOW else [], id=p.stem)
    for p in PAGES
    if BLOCK.search(p.read_text())
]


@pytest.mark.parametrize("page", RUN)
def test_code_blocks_run(page, tmp_path, monkeypatch, capsys):
    """Python and shell blocks of a page, in order, in one folder; long pages in a process of their own.

    A block with a title is a file of that name.
    """
    for name, text in FILE.findall(page.read_text()):
        (tmp_path / name).write_text(text)
    (tmp_path / "problems").symlink_to(ROOT / "problems")
    script = tmp_path / "page.py"
    blocks = BLOCK.findall(page.read_text())
    script.write_text("\n".join(SHELL.format(text) if language == "sh" else text for language, text in blocks))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    if page.stem in SLOW:
        command = [sys.executable, "-W", "error", str(script)]
        environment = {**os.environ, "PATH": path}
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stderr
        output = done.stdout
    else:
        monkeypatch.setenv("PATH", path)
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(script), run_name="__main__")
        output = capsys.readouterr().out
    assert "nan" not in output
    for wanted in EXPECTED.get(page.stem, ()):
        assert wanted in output


EXPECTED = {
    "index": ("mu certified in [0.0", "no placement is more than "),
    "my_mesh_my_hand": (
        "9 joints, 3 fingertips",
        "part: Solved",
        "within max_force = 15 N",
        "confirmed: held as solved",
    ),
    "grasp_metrics": ("32 of 40 are force-closed", "that is proved"),
    "gripper_and_part": (
        "1 of 1 parts have a grasp",
        "part: Solved",
        "set the gripper to 7.",
        "the task needs 6.",
        "; the limit is 40 N",
        "of the pads on their faces",
    ),
    "data_sets": ("4 grasps of 2 problems", "verified: 4 grasps verified", "1 file written to tables"),
    "how_close": ("mu at most 0.4", "ok   leaves: "),
    "hands": ("mu certified in [0.4", "spread, fingers", "confirmed: held as solved, lost without the squeeze"),
    "tasks": ("of 2000 wrenches inside", "less friction, [0."),
    "experiments": ("plate: 8 of 8 solves done", "1 free, rough [0.8"),
    "own_kinds": (
        "by the body's own functions",
        "ok   least distance: stated 0.0",
        "verified: ",
        "written to egg.faces",
    ),
    "interop": ("stable: True [0.",),
    "measures": ("True True", "False ["),
    "getting_started": ("box: Solved", "verified", "written to box.html", "rectangle, Example 3-10: Solved"),
    "my_solve_failed": ("LOCALLY_INFEASIBLE", "FrictionContact.friction: got -0.5"),
    "simulation": ("confirmed: the grasp as solved holds what is certified, and loses what is more", "\nTrue "),
}


def test_every_block_says_what_it_is():
    """No block escapes the tests by having no language."""
    for page in PAGES:
        fences = re.findall(r'^```(\w*)(?: title=".*")?$', page.read_text(), re.MULTILINE)
        assert all(opening in ("python", "sh", "text") for opening in fences[::2]), page.name
        assert all(closing == "" for closing in fences[1::2]), page.name


@pytest.fixture(scope="module")
def site():
    """The site's folder: one process of a run builds it, the others wait for it."""
    folder = Path(os.environ["NLPGRASP_CACHE"]) / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "true"}
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.with_suffix(".built").exists():
            done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=ROOT, env=environment)
            assert done.returncode == 0, done.stdout + done.stderr
            folder.with_suffix(".built").touch()
    return folder


class _Links(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self):
        super().__init__()
        self.links, self.anchors = [], set()

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if given.get("id"):
            self.anchors.add(given["id"])
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        if tag in ("img", "script") and given.get("src"):
            self.links.append(given["src"])
        if tag == "link" and given.get("href"):
            self.links.append(given["href"])


@pytest.mark.slow
def test_no_link_is_broken(site):
    parsed = {}
    for page in site.rglob("*.html"):
        if page.name != "404.html":
            parsed[page.resolve()] = _Links()
            parsed[page.resolve()].feed(page.read_text(encoding="utf-8"))
    assert len(parsed) == len(PAGES)
    checked = 0
    for page, found in parsed.items():
        for link in found.links:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https", "mailto", "data"):
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            assert target.exists(), f"{page.name}: {link}"
            if parts.fragment and target in parsed:
                anchors = parsed[target].anchors | {"__skip", "__consent"}
                assert unquote(parts.fragment) in anchors, f"{page.name}: {link}"
            checked += 1
    assert checked > 500


@pytest.mark.slow
def test_the_site_needs_no_network(site):
    """Nothing is loaded from elsewhere: links that one may follow are another matter."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'<(?:script|img)[^>]+src="https?://', text), page.name
        assert not re.search(r'<link[^>]+rel="(?:stylesheet|preconnect)"[^>]+href="https?://', text), page.name


@pytest.mark.slow
def test_the_search_is_on_disk(site):
    """The index as a script, and what stands in for a Worker, which browsers do not start for files."""
    assert (site / "search" / "search_index.js").read_text(encoding="utf-8").startswith("var __index = ")
    for page in ("index.html", "paper/02_contacts.html"):
        text = (site / page).read_text(encoding="utf-8")
        assert re.search(r'<script[^>]+src="(?:\.\./)?assets/iframe-worker\.js"', text), page


@pytest.mark.slow
@pytest.mark.skipif(not (BROWSER and DRIVER), reason="no chromium: make browser")
@pytest.mark.parametrize("page", ["index.html", "paper/02_contacts.html"])
def test_a_browser_searches_from_disk(site, page):
    from selenium import webdriver
    from selenium.webdriver.support.ui import WebDriverWait

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "window-size=1300,900"):
        options.add_argument(f"--{flag}")
    with webdriver.Chrome(options, webdriver.ChromeService(DRIVER)) as browser:
        browser.get((site / page).as_uri())
        browser.find_element("css selector", ".md-search__input").send_keys("Ferrari")
        links = WebDriverWait(browser, 30).until(lambda b: b.find_elements("css selector", ".md-search-result__link"))
        assert any("ferrari_canny" in link.get_attribute("href") for link in links)


def test_extras_are_spelled_in_one_way():
    """As the errors that name them do, which works in any folder; but for all of them at once in a checkout."""
    defined = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    places = [
        *PAGES,
        ROOT / "README.md",
        *(ROOT / "docs" / "notebooks").glob("*.ipynb"),
        *(ROOT / "nlpgrasp").rglob("*.py"),
    ]
    named = []
    for path in places:
        text = path.read_text(encoding="utf-8").replace('\\"', '"')
        assert set(re.findall(r'install[^\n`]* "?(\.\[[^\n`" ]*)', text)) <= {".[hands,sim,viz,view]"}, path.name
        named += re.findall(r'pip install "nlpgrasp\[([a-z,]+)\]"', text)
    assert {"hands", "view", "descriptions"} <= set(named)
    assert {extra for each in named for extra in each.split(",")} <= set(defined)


@pytest.mark.slow
def test_every_public_name_is_in_the_reference(site):
    page = (site / "api.html").read_text(encoding="utf-8")
    presets = set(ng.hands.presets.__all__)
    for name in (set(ng.__all__) - {"__version__", "hands"}) | presets:
        assert re.search(rf'<h3 id="nlpgrasp\.(?:\w+\.)*{name}"', page), name
    assert "doc-module" not in page  # functions and classes, not modules of their names


@pytest.mark.slow
def test_every_parameter_is_described(site):
    page = (site / "api.html").read_text(encoding="utf-8")
    items = re.findall(r'<li class="doc-section-item field-body">(.*?)</li>', page, re.DOTALL)
    assert len(items) > 500
    described = [item.partition('<div class="doc-md-description">')[2] for item in items]
    assert [i for i, text in zip(items, described, strict=True) if not re.sub(r"<[^>]+>|\s", "", text)] == []


def test_the_task_is_what_fingers_exert():
    """One word for the sign: a task's wrenches are exerted by the fingers, not resisted."""
    told = [path for path in (*PAGES, ROOT / "README.md") if re.search(r"\bresist", path.read_text(encoding="utf-8"))]
    package = [p for p in (ROOT / "nlpgrasp").rglob("*.py") if re.search(r"\bresist", p.read_text(encoding="utf-8"))]
    assert told + package == []


def test_every_problem_script_is_in_the_gallery(problems_folder):
    page = (ROOT / "docs" / "gallery.md").read_text()
    for script in problems_folder.glob("*.py"):
        entry = rf"`problems/{script.name}`: \d+ contacts, mu(-tilde)? certified in \*\*\[.*?\]\*\*, \d+ s"
        assert re.search(entry, page), f"{script.name}: make gallery"
        assert (ROOT / "docs" / "pictures" / "gallery" / f"{script.stem}.png").is_file()


def test_files_named_in_the_architecture_exist():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+/[\w/]+\.py)`", text))
    assert len(named) > 60
    assert [n for n in sorted(named) if not ((ROOT / "nlpgrasp" / n).is_file() or (ROOT / n).is_file())] == []

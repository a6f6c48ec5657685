"""A batch of parts: files and a row each, finished parts stay, failures are rows."""

import html
import json
import os
import re
import shutil
from dataclasses import replace
from urllib.parse import unquote, urlsplit

import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.report.parts import PartResult, write_parts_page
from nlpgrasp.report.pictures import draw_grasp
from tests.cli.test_cli import run_here
from tests.held_block import GRIPPER, held_block

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")

QUICK = ng.SolveOptions(workers=1, rounds=2, global_bound=False)


def problem(part, gripper):
    task = ng.lift(part.centroid, 0.2) + ng.disturbance(1.0, 0.01, part.centroid)
    table = ng.Table.under(part, 0.001)
    return ng.GraspProblem(part, ng.SoftContact(0.6, 0.005), task, hand=gripper, constraints=[table], name="part")


def solved(folder, task=problem, **more):
    return ng.solve_parts(folder / "parts", GRIPPER, task, folder / "out", "mm", 1, 0, QUICK, **{"keep": 2, **more})


def block(folder, name, *extents):
    box = trimesh.creation.box(extents)
    box.export(folder / "parts" / f"{name}.stl")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two blocks and a file that is no mesh, solved once."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "parts").mkdir()
    block(folder, "long & thin", 90, 30, 40)
    block(folder, "plate", 60, 40, 30)
    (folder / "parts" / "broken.stl").write_text("nothing")
    (folder / "parts" / "readme.txt").write_text("no part")
    return folder


@pytest.fixture(scope="module")
def batch(folder):
    return solved(folder)


@pytest.mark.slow
def test_each_part_has_its_files_and_a_row(folder, batch):
    assert [part.name for part in batch.parts] == ["broken", "long & thin", "plate"]
    assert {p.name for p in (folder / "out").iterdir() if p.name[0] != "."} == {
        "index.html",
        *(f"{name}{end}" for name in ("long & thin", "plate") for end in (".json", ".poses.csv", ".png")),
    }
    page = batch.page.read_text(encoding="utf-8")
    rows = re.findall("<tr><td data-head.*?</tr>", page, re.DOTALL)
    assert [row.split("</td>")[0].removeprefix('<tr><td data-head="Part">') for row in rows] == [
        "broken",
        "long &amp; thin",
        "plate",
    ]
    assert "src=" not in rows[0]
    for part, row in zip(batch.parts[1:], rows[1:], strict=True):
        solution = part.load()
        assert 'src="data:image/png;base64,' in row
        assert solution.grip_line()[1:] in row
        assert solution.friction_line()[1:] in row
        assert "mm</td>" in row
        assert f"{len(solution.grasps)}, {len(solution.grasps)} with a free way in" in row
    assert 'href="plate.poses.csv"' in page
    assert "nothing is ranked" in page


def test_links_lead_to_files_whatever_a_part_is_called(tmp_path):
    names = ["part #2", "a?b", "50%25", "javascript:alert(1)", '"><script>alert(1)</script>'.replace("/", "|")]
    solution = held_block()
    parts = [PartResult(name, solution.save(tmp_path / f"{name}.json")) for name in names]
    page = write_parts_page(parts, tmp_path / "p.html", "<b>")
    text = page.read_text()
    links = [urlsplit(html.unescape(link)) for link in re.findall(r'<a href="([^"]*)"', text)]
    assert [unquote(link.path) for link in links] == [f"{name}.json" for name in names]
    assert not any(link.scheme or link.netloc or link.query or link.fragment for link in links)
    assert "<script>alert" not in text


@pytest.mark.slow
def test_a_part_that_fails_is_a_row_with_its_reason(batch):
    broken = batch.parts[0]
    assert (broken.file, broken.is_new, batch.complete) == (None, False, False)
    assert "broken.stl" in broken.failure
    assert "broken.stl" in batch.page.read_text(encoding="utf-8")
    assert str(batch).startswith("2 of 3 parts have a grasp, 2 solved now")
    with pytest.raises(InputError, match=r"broken\.stl"):
        broken.load()


def test_the_page_counts_the_free_grasps_of_the_table(tmp_path):
    """A pad over an edge counts as not free on the page and in the table, and is printed with its share."""
    solution = held_block()
    others = [replace(grasp, hand={**grasp.hand, "pads": [0.7, 0.95]}) for grasp in solution.others[:1]]
    file = replace(solution, others=(*others, *solution.others[1:])).save(tmp_path / "block.json")
    page = write_parts_page([PartResult("block", file)], tmp_path / "index.html", "Parts").read_text(encoding="utf-8")
    free = [poses.is_free for poses in ng.robot_poses(ng.GraspSolution.load(file))]
    assert sum(free) == len(free) - 1
    assert f"{len(free)}, {sum(free)} with a free way in and pads on their faces" in page
    printed = str(ng.GraspSolution.load(file))
    assert printed.count("free, 70 % on the face") + printed.count("free, flipped, 70 % on the face") == 1


def test_a_part_without_a_grasp_has_a_picture_of_its_body_and_a_row_with_the_reason(tmp_path, monkeypatch):
    def fail(problem, **_):
        return ng.GraspSolution(ng.Status.LOCALLY_INFEASIBLE, "wide", problem.to_dict(), source=problem)

    monkeypatch.setattr("nlpgrasp.report.parts.solve", fail)
    (tmp_path / "parts").mkdir()
    block(tmp_path, "wide", 200, 200, 200)
    batch = solved(tmp_path)
    (part,) = batch.parts
    solution = part.load()
    assert solution.grasp is None
    assert {p.name for p in batch.folder.iterdir() if p.name[0] != "."} == {"index.html", "wide.json", "wide.png"}
    page = batch.page.read_text(encoding="utf-8")
    assert 'src="data:image/png;base64,' in page
    assert html.escape(part.failure[1:]) in page
    assert "Error" not in part.failure
    assert not draw_grasp(solution).axes[0].axison  # the file does not contain the mesh


@pytest.mark.slow
def test_finished_parts_stay_and_a_changed_one_is_solved_again(folder, batch):
    out = folder / "out"
    before = {name: (out / f"{name}.json").read_bytes() for name in ("long & thin", "plate")}
    again = solved(folder)
    assert [part.is_new for part in again.parts] == [False, False, False]
    assert [part.failure == "" for part in again.parts] == [False, True, True]
    assert str(again).startswith("2 of 3 parts have a grasp, 0 solved now")
    block(folder, "plate", 62, 40, 30)
    seen = []
    changed = solved(folder, progress=seen.append)
    assert [part.is_new for part in changed.parts] == [False, False, True]
    assert tuple(seen) == changed.parts
    assert (out / "long & thin.json").read_bytes() == before["long & thin"]
    assert (out / "plate.json").read_bytes() != before["plate"]
    assert changed.parts[2].load().hand["opening"] != pytest.approx(batch.parts[1].load().hand["opening"])


@pytest.mark.slow
def test_an_error_of_a_function_leaves_the_other_parts(folder, batch, tmp_path):
    def bad(part, gripper):
        raise ZeroDivisionError(f"no mass of {part.source}")

    os.symlink(folder / "parts", tmp_path / "parts")
    failed = solved(tmp_path, bad)
    assert [part.failure for part in failed.parts[1:]] == [
        f"ZeroDivisionError: no mass of {name}.stl" for name in ("long & thin", "plate")
    ]
    assert (folder / "out" / "plate.json").is_file()  # what the batch before found


def test_a_batch_that_is_killed_leaves_the_page_of_what_is_done(tmp_path, monkeypatch):
    """A kill leaves no time for a last word: what ``solve`` sees on disk when it begins with a part is all there is."""
    (tmp_path / "parts").mkdir()
    block(tmp_path, "a", 90, 30, 40)
    block(tmp_path, "b", 60, 40, 30)
    pages = []

    def killed(problem, **_):
        pages.append((tmp_path / "out" / "index.html").read_text(encoding="utf-8"))
        if len(pages) == 2:
            raise SystemExit
        return held_block()

    monkeypatch.setattr("nlpgrasp.report.parts.solve", killed)
    with pytest.raises(SystemExit):
        solved(tmp_path)
    assert "0 of 2 parts have a grasp. 2 not solved yet." in pages[0]
    assert "1 of 2 parts have a grasp. 1 not solved yet." in pages[1]
    assert 'href="a.poses.csv"' in pages[1]
    file = tmp_path / "out" / "a.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps({**data, "solver": {**data["solver"], "problem_digest": "another"}}), encoding="utf-8")
    pages.clear()

    def stopped(problem, **_):
        pages.append((tmp_path / "out" / "index.html").read_text(encoding="utf-8"))
        raise KeyboardInterrupt

    monkeypatch.setattr("nlpgrasp.report.parts.solve", stopped)
    batch = solved(tmp_path)
    assert "Of an earlier run: whether the part" in pages[0]
    assert [part.failure for part in batch.parts] == ["not solved yet"] * 2  # a was begun anew
    assert batch.page.read_text(encoding="utf-8").count("Not solved yet") == 2


@pytest.mark.skipif(not (BROWSER and DRIVER), reason="needs Debian's chromium and chromium-driver: make browser")
def test_rows_are_cards_on_a_phone(tmp_path):
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    file = held_block().save(tmp_path / "block.json")
    page = write_parts_page([PartResult("block", file)], tmp_path / "index.html", "Parts")
    options = webdriver.ChromeOptions()
    for flag in ("--headless=new", "--no-sandbox", "--disable-gpu"):
        options.add_argument(flag)
    with webdriver.Chrome(options=options, service=Service(DRIVER)) as browser:
        for width, is_card in ((390, True), (1300, False)):
            size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": True}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            browser.get(page.as_uri())
            assert browser.execute_script("return document.documentElement.scrollWidth") == width
            assert browser.execute_script("const w = document.querySelector('.cards'); return w.scrollWidth") <= width
            display = browser.execute_script("return getComputedStyle(document.querySelector('td')).display")
            assert (display == "block") is is_card


def test_a_task_alone_stands_the_part_on_a_table_between_the_grippers_pads(folder, tmp_path, monkeypatch):
    asked = []

    def keep_problem(problem, **_):
        asked.append(problem)
        raise KeyboardInterrupt

    monkeypatch.setattr("nlpgrasp.report.parts.solve", keep_problem)
    os.symlink(folder / "parts", tmp_path / "parts")
    stopped = solved(tmp_path, lambda part, gripper: ng.lift(part.centroid, 0.2))
    (problem,) = asked
    assert problem.models[0] == ng.PlaneContact(extents=(0.02, 0.012), friction=0.5, direction=(0, 0, -1))
    assert problem.constraints[0].height == pytest.approx(-0.02)
    assert (problem.hand, problem.name) == (GRIPPER, "long & thin")
    assert [part.failure for part in stopped.parts[1:]] == ["not solved yet"] * 2


@pytest.mark.slow
def test_the_command_takes_the_grippers_dimensions_from_the_script(folder, batch, tmp_path):
    script = tmp_path / "lift.py"
    script.write_text(
        "import nlpgrasp as ng\n"
        "def gripper():\n    return ng.ParallelJaw(0.02, pad=(0.01, 0.01), finger=(0.06, 0.012, 0.012))\n"
        "def problem(part, gripper):\n    raise ValueError(f'{part.source} in {gripper.opening} m')\n"
    )
    result = run_here("parts", folder / "parts", "--task", script, "--out", "out", "--starts", 1, cwd=tmp_path)
    assert result.returncode == 1
    assert result.stdout.startswith("0 of 3 parts have a grasp")
    assert "plate: ValueError: plate.stl in 0.02 m" in result.stdout
    script.write_text("def task(part):\n    return 1\n")
    result = run_here("parts", folder / "parts", "--task", script, "--out", "out", cwd=tmp_path)
    assert "--gripper: got nothing, expected the name of a preset, or a function gripper()" in result.stderr
    script.write_text("tasks = 1\n")
    result = run_here("parts", folder / "parts", "--task", script, "--out", "out", cwd=tmp_path)
    assert "neither task() nor problem(), expected a script with a function task(part)" in result.stderr


def lifted(mass):
    def task(part, gripper):
        return ng.lift(part.centroid, mass)

    return task


def solve_stub(problem, **_):
    """Return a grasp of another block, whose problem is that asked for."""
    return replace(held_block(), problem=problem.to_dict())


def test_a_kill_leaves_no_result_under_another_problem(tmp_path, monkeypatch):
    """Whatever is written when a run ends, the file of a part states the problem that it is of."""
    (tmp_path / "parts").mkdir()
    block(tmp_path, "a", 60, 40, 30)
    file = tmp_path / "out" / "a.json"
    tasks = []

    def solve(problem, **_):
        tasks.append(problem.to_dict()["task"])
        return solve_stub(problem)

    def killed(*_):
        raise SystemExit

    monkeypatch.setattr("nlpgrasp.report.parts.solve", solve)
    monkeypatch.setattr("nlpgrasp.report.parts.draw_grasp", lambda *_: None)
    monkeypatch.setattr("nlpgrasp.report.parts.write_figure", lambda *_: None)
    solved(tmp_path, lifted(2.0))
    for name in ("write_bytes", "write_figure"):
        with monkeypatch.context() as context:
            context.setattr(f"nlpgrasp.report.parts.{name}", killed)
            with pytest.raises(SystemExit):
                solved(tmp_path, lifted(0.4))
        tasks.clear()
        batch = solved(tmp_path, lifted(2.0))
        assert tasks == [ng.GraspSolution.load(file).problem["task"]]
        assert [part.is_new for part in batch.parts] == [True]
    assert [part.is_new for part in solved(tmp_path, lifted(2.0)).parts] == [False]


def test_views_of_a_finished_part_are_restored(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    block(tmp_path, "a", 60, 40, 30)
    monkeypatch.setattr("nlpgrasp.report.parts.solve", solve_stub)
    solved(tmp_path, lifted(2.0))
    poses, picture = (tmp_path / "out" / f"a{ending}" for ending in (".poses.csv", ".png"))
    expected = poses.read_bytes()
    poses.write_bytes(expected.replace(b",part,", b",cell,"))
    picture.unlink()
    assert [part.is_new for part in solved(tmp_path, lifted(2.0)).parts] == [False]
    assert poses.read_bytes() == expected
    assert picture.is_file()


def test_a_folder_of_parts_is_for_one_run_at_a_time(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    block(tmp_path, "a", 60, 40, 30)

    def second(problem, **_):
        with pytest.raises(InputError, match="in use by another run"):
            solved(tmp_path)
        return solve_stub(problem)

    monkeypatch.setattr("nlpgrasp.report.parts.solve", second)
    assert [part.is_new for part in solved(tmp_path).parts] == [True]


def test_bad_folders_are_refused(folder, tmp_path):
    with pytest.raises(InputError, match="a folder of mesh files that exists"):
        ng.solve_parts(tmp_path / "none", GRIPPER, problem, tmp_path / "out")
    with pytest.raises(InputError, match="without a mesh file"):
        ng.solve_parts(tmp_path, GRIPPER, problem, tmp_path / "out")
    with pytest.raises(InputError, match="another folder than that of the parts"):
        ng.solve_parts(folder / "parts", GRIPPER, problem, folder / "parts")
    for ending in ("stl", "ply"):
        trimesh.creation.box([10, 10, 10]).export(tmp_path / f"same.{ending}")
    with pytest.raises(InputError, match=r"same\.ply and same\.stl, expected a name of its own"):
        ng.solve_parts(tmp_path, GRIPPER, problem, tmp_path / "out")

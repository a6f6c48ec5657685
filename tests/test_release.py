"""What is released: one version, a wheel with all it needs, and a wheel that works where there is nothing else."""

import json
import re
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

import nlpgrasp as ng

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist, built as ``make dist`` does."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


def test_there_is_one_version(built):
    assert version("nlpgrasp") == ng.__version__
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == ng.__version__
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest[1] == ng.__version__
    assert all(f"nlpgrasp-{ng.__version__}" in path.name for path in built)
    assert ng.__version__ not in (ROOT / "pyproject.toml").read_text()


def test_the_wheel_holds_the_package_and_nothing_else(built):
    names = zipfile.ZipFile(built[0]).namelist()
    inside = {p.relative_to(ROOT).as_posix() for p in (ROOT / "nlpgrasp").rglob("*") if p.is_file()}
    inside = {name for name in inside if "__pycache__" not in name}
    assert inside <= set(names)
    assert {"report.css", "view.js", "nlpgrasp-1.schema.json"} <= {Path(n).name for n in names}
    assert {name.split("/")[0] for name in names} == {"nlpgrasp", f"nlpgrasp-{ng.__version__}.dist-info"}
    metadata = zipfile.ZipFile(built[0]).read(f"nlpgrasp-{ng.__version__}.dist-info/METADATA").decode()
    for extra in ("hands", "viz", "sim", "cluster", "tables"):
        assert f"Provides-Extra: {extra}" in metadata


def test_the_sdist_holds_what_a_checkout_does(built):
    with tarfile.open(built[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    top = {
        "CITATION.cff",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "LICENSE",
        "Makefile",
        "mkdocs.yml",
        "README.md",
        "requirements.lock",
    }
    assert (
        top
        | {
            "docs/index.md",
            "paper/paper.md",
            "problems/pencil.py",
            "benchmarks/peers/run.py",
            "tests/test_release.py",
            "nlpgrasp/version.py",
        }
        <= names
    )


@pytest.mark.slow
def test_an_index_would_take_them(built):
    command = [sys.executable, "-m", "twine", "check", "--strict", *map(str, built)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASSED") == 2


def test_the_citation_is_whole():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors", "version", "license", "type"} <= citation.keys()
    assert re.fullmatch(r"10\.\d{4,}/\S+", citation["preferred-citation"]["doi"])


def test_what_the_paper_cites_is_in_its_bibliography():
    text, listed = ((ROOT / "paper" / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib"))
    keys = re.findall(r"^@\w+\{(\w+),", listed, re.MULTILINE)
    assert set(re.findall(r"@(\w+)", text.partition("---\n\n")[2])) == set(keys)
    assert len(re.findall(r"^  doi +=", listed, re.MULTILINE)) == len(keys) == len(set(keys))


def test_the_forms_and_the_workflow_are_read():
    for path in (ROOT / ".github").rglob("*.yml"):
        read = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert isinstance(read, dict), path.name
    runs = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert "bash .ci/run" in runs
    assert {"macos-latest", "windows-latest"} <= set(re.findall(r"[a-z]+-latest", runs))


@pytest.mark.slow
def test_the_wheel_runs_the_demo_in_an_empty_environment(built, tmp_path):
    """Needs a package index: everything but the wheel is installed from it."""
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "empty")], check=True)
    python = tmp_path / "empty" / "bin" / "python"
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(built[0])]
    done = subprocess.run(pip, capture_output=True, text=True, timeout=900)
    if done.returncode and "Could not find a version" in done.stderr:
        pytest.skip("no package index to install from")
    assert done.returncode == 0, done.stderr

    def run(*arguments):
        command = [str(tmp_path / "empty" / "bin" / "nlpgrasp"), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)

    demo = run("solve", ROOT / "problems" / "screwdriver.py", "--out", "screwdriver.json")
    assert demo.returncode == 0, demo.stderr
    assert run("verify", "screwdriver.json").returncode == 0
    assert run("report", "screwdriver.json").returncode == 0
    assert run("export", "screwdriver.json", "--to", "mjcf").returncode == 0
    missing = run("simulate", "screwdriver.json")
    assert missing.returncode == 2
    assert 'pip install "nlpgrasp[sim]"' in missing.stderr
    assert json.loads((tmp_path / "screwdriver.json").read_text())["created_by"]["nlpgrasp"] == ng.__version__

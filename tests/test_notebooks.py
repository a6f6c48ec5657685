"""The notebooks: stripped of what they put out, and every cell runs."""

import json
import warnings
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "docs" / "notebooks").glob("*.ipynb"))
TEXTS = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in NOTEBOOKS}


def code(name):
    return [cell for cell in TEXTS[name]["cells"] if cell["cell_type"] == "code"]


def test_there_are_three():
    assert set(TEXTS) == {"first_grasp", "task_from_a_recording", "your_own_hand"}
    page = (NOTEBOOKS[0].parents[1] / "notebooks.md").read_text(encoding="utf-8")
    assert [path.name for path in NOTEBOOKS if f"notebooks/{path.name}" not in page] == []


@pytest.mark.parametrize("name", TEXTS)
def test_the_repository_holds_no_outputs(name):
    assert (TEXTS[name]["nbformat"], TEXTS[name]["nbformat_minor"]) == (4, 5)
    assert len(code(name)) >= 4
    assert [c for c in code(name) if c["outputs"] or c["execution_count"] is not None or c["metadata"]] == []
    assert TEXTS[name]["cells"][0]["source"][0].startswith("# ")


@pytest.mark.slow
def test_cells_run_in_order(monkeypatch, capsys):
    """One of them without a kernel: one process, one set of names."""
    monkeypatch.chdir(NOTEBOOKS[0].parent)
    names = {}
    for cell in code("task_from_a_recording"):
        exec(compile("".join(cell["source"]), cell["id"], "exec"), names)  # noqa: S102
    assert "made for the recording: [0." in capsys.readouterr().out
    found, general = names["solution"], names["general"]
    assert found.mu.lower >= 0.99 * names["ng"].mu(general.grasp, names["fit"].task).upper


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=list(TEXTS))
def test_a_real_kernel_runs_them(path):
    with warnings.catch_warnings():  # of the kernel's client, about sockets and event loops
        warnings.simplefilter("ignore")
        import nbclient
        import nbformat

        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        place = {"metadata": {"path": str(path.parent)}}
        done = nbclient.NotebookClient(notebook, timeout=300, resources=place).execute()
    outputs = [out for cell in done.cells for out in cell.get("outputs", ())]
    printed = "".join(out["text"] for out in outputs if out["output_type"] == "stream" and out["name"] == "stdout")
    assert "certified in [0." in printed
    assert [out["text"] for out in outputs if out.get("name") == "stderr"] == []

"""Commands ``nlpgrasp task``: fit, list, show."""

import json

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.cli import main as command_line
from tests.cli.test_cli import refused, run

HEADER = "Fx [N],Fy [N],Fz [N],Tx [Nmm],Ty [Nmm],Tz [Nmm]\n"


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Return what the command line does in this process: exit code, lines out, lines of errors."""
    monkeypatch.chdir(tmp_path)

    def called(*arguments):
        monkeypatch.setattr("sys.argv", ["nlpgrasp", "task", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            command_line.main()
        streams = capsys.readouterr()
        return ended.value.code, streams.out.splitlines(), streams.err.splitlines()

    return called


def record(path, rows):
    path.write_text(HEADER + "\n".join(",".join(map(repr, map(float, row))) for row in rows))
    return rows * [1, 1, 1, 1e-3, 1e-3, 1e-3]


def test_a_recording_goes_into_a_library_and_the_next_updates_it(call, tmp_path, rng):
    first, second = (record(tmp_path / f"{i}.csv", rng.standard_normal((300, 6))) for i in range(2))
    code, out, err = call("fit", "0.csv", "--into", "lib", "--name", "wiping", "--tag", "clean", "--frame", "z up")
    assert (code, err) == (0, [])
    assert out[0].startswith("added in lib: wiping: ellipsoid of least volume around 300 wrenches")
    assert out[-1] == "0.csv: Nmm converted to N and Nm"
    code, out, err = call("fit", "1.csv", "--into", "lib", "--name", "wiping", "--exerts", "fingers", "--json")
    assert (code, err) == (0, [])
    data = json.loads(out[0])
    assert (data["did"], data["wrenches"], data["tags"]) == ("updated", 600, ["clean"])
    assert [o["source"] for o in data["provenance"]] == ["0.csv", "1.csv"]
    task = ng.TaskLibrary(tmp_path / "lib")["wiping"]
    rows = np.concatenate([-first, second])
    assert np.max(np.linalg.norm((rows - task.center) @ np.linalg.pinv(task.axes), axis=1)) <= 1.0 + 1e-8
    code, out, _ = call("list", "lib")
    assert code == 0
    assert out[1].split() == ["wiping", "6", "600", "N,", "N", "m"]
    code, out, _ = call("show", "wiping", "--library", "lib")
    assert code == 0
    assert out[1] == "  frame: z up; moments about [0.0, 0.0, 0.0]"
    assert out[-1].startswith("  m_z [N m]: -0.0")


def test_the_ready_library_is_listed_and_shown(call):
    code, out, _ = call("list", "--search", "CUP", "--json")
    assert code == 0
    assert [json.loads(line)["name"] for line in out] == ["carrying a filled cup", "drinking from a tea cup"]
    code, out, _ = call("show", "peg in hole", "--json")
    (line,) = out
    assert json.loads(line)["task"]["center"] == [0.5, 0.0, -3.0, 0.0, 0.0, 0.0]
    assert json.loads(line)["units"] == {"force": "N", "torque": "N m"}


def test_warnings_are_lines_of_the_command(call, tmp_path, rng):
    record(tmp_path / "flat.csv", rng.standard_normal((100, 6)) * [1, 1, 1, 0, 0, 0])
    code, out, err = call("fit", "flat.csv", "--into", "lib", "--name", "flat")
    assert code == 0
    assert err == ["nlpgrasp: flat: the wrenches differ in 3 of 6 directions only: the ellipsoid is flat"]
    assert "flat: 3 of 6 directions" in out[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["list", "nowhere"], "library: got nowhere (no such folder), expected a folder of task entries"),
        (["list", "good.csv"], "library: got good.csv (not a folder), expected a folder"),
        (["show", "hammer"], "expected the name of an entry, such as 'striking with a hammer'"),
        (["show", "peg", "--library", "nowhere"], "nowhere (no such folder)"),
        (["fit", "none.csv", "--into", "lib", "--name", "a"], "none.csv: got FileNotFoundError"),
        (["fit", "bad.csv", "--into", "lib", "--name", "a"], "1 row with NaN or infinity (3)"),
        (["fit", "good.csv", "--into", "lib", "--name", "a  b"], "with single spaces"),
        (["fit", "good.csv", "--into", "good.csv", "--name", "a"], "not a folder"),
        (["fit", "good.csv", "--into", "no/lib", "--name", "a"], "a folder in one that exists"),
        (["fit", "good.csv", "--into", "lib", "--name", "a", "--outliers", "0.6"], "a share below 0.5"),
        (["fit", "good.csv", "--into", "lib", "--name", "a", "--probability", "2"], "a share between 0 and 1"),
        (["fit", "good.csv", "--into", "lib", "--name", "a", "--units", "N", "parsec"], "'parsec'"),
        (["fit", "good.csv", "--into", "lib"], "--name"),
        (["show"], "NAME"),
    ],
)
def test_bad_use_is_one_line_and_exit_code_2(arguments, message, call, tmp_path, rng):
    record(tmp_path / "good.csv", rng.standard_normal((30, 6)))
    (tmp_path / "bad.csv").write_text(HEADER + "1,2,3,4,5,6\n1,2,3,nan,5,6\n6,5,4,3,2,1\n")
    code, out, err = call(*arguments)
    assert (code, out) == (2, [])
    (line,) = err
    assert line.startswith("nlpgrasp: ")
    assert message in line
    assert not (tmp_path / "lib").exists()


def test_what_a_new_entry_says_is_refused_for_one_that_is_there(call, tmp_path, rng):
    record(tmp_path / "good.csv", rng.standard_normal((30, 6)))
    call("fit", "good.csv", "--into", "lib", "--name", "a")
    code, _, (line,) = call("fit", "good.csv", "--into", "lib", "--name", "a", "--tag", "x")
    assert code == 2
    assert "--tag: got ['x'], expected a new --name with it" in line


@pytest.mark.slow
def test_a_broken_entry_is_one_line_in_a_process_of_its_own(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "peg.json").write_text('{"schema": "nlpgrasp-task/1", "name": "p')
    assert "peg.json: got not valid JSON at line 1" in refused(run("task", "list", "lib", cwd=tmp_path))

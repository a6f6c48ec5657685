"""Registry of formats: required content, refused names and endings."""

from dataclasses import replace
from pathlib import Path

import pytest

from nlpgrasp.errors import InputError
from nlpgrasp.interop import ExportFormat, ExportOptions, Need, ReadFormat, contacts_csv, glb, register, register_reader
from nlpgrasp.interop.registry import format_named, formats, reader_of
from nlpgrasp.solution.solution import GraspSolution

FILES = Path(__file__).parents[1] / "solution" / "files"


@pytest.fixture(scope="module")
def box():
    return GraspSolution.load(FILES / "box.json")


@pytest.fixture(scope="module")
def none():
    return GraspSolution.load(FILES / "none.json")


def test_formats_of_the_package():
    endings = {export_format.name: export_format.ending for export_format in formats()}
    assert endings.items() >= {"csv": ".csv", "glb": ".glb", "isaac_grasp": ".yaml", "mjcf": ".xml"}.items()
    assert endings.items() >= {"moveit": ".grasps.yaml", "npz": ".npz", "dexgraspbench": ".npy"}.items()
    assert [export_format.name for export_format in formats() if export_format.takes_hand] == ["mjcf"]


def test_a_format_writes_what_its_function_returns(box):
    assert format_named("csv").export(box) == contacts_csv(box).encode()
    assert format_named("glb").export(box) == glb(box)


@pytest.mark.parametrize("name", ["csv", "glb", "isaac_grasp", "mjcf", "moveit", "npz", "dexgraspbench"])
def test_no_format_is_written_without_a_grasp(name, none):
    with pytest.raises(InputError, match="got no grasp, expected a solution with a grasp"):
        format_named(name).export(none)


def test_needs_are_checked_before_the_function_is_called(box, none):
    calls = []
    export_format = ExportFormat("seen", ".seen", "nothing", lambda s, o: calls.append((s, o)) or "", Need.DRAWING)
    with pytest.raises(InputError, match="a grasp without a drawing"):
        export_format.export(
            replace(box, drawing=None, source=None, problem={**box.problem, "hand": {"type": "unknown"}})
        )
    assert calls == []
    lenient = replace(export_format, needs=Need.NOTHING)
    assert lenient.export(none, ExportOptions(Path("hand.urdf"))) == b""
    assert calls == [(none, ExportOptions(Path("hand.urdf")))]


def test_a_name_or_an_ending_stands_for_one_format():
    register(format_named("csv"))  # again: nothing changes
    with pytest.raises(InputError, match=r"ExportFormat.name: got csv, expected another name"):
        register(replace(format_named("csv"), ending=".txt"))
    with pytest.raises(InputError, match=r"ReadFormat.endings: got .yaml, expected another ending"):
        register_reader(ReadFormat((".new", ".yaml"), (), lambda path, options: iter(())))
    with pytest.raises(InputError, match=r"x.new: got the ending .new, expected one of .json, .csv, "):
        reader_of("x.new")
    with pytest.raises(InputError, match="got fbx, expected one of csv, glb, isaac_grasp, mjcf"):
        format_named("fbx")


@pytest.mark.parametrize("fields", [{"name": "my format"}, {"ending": "csv"}, {"ending": "."}, {"write": "text"}])
def test_formats_that_are_refused(fields):
    with pytest.raises(InputError, match="ExportFormat." + next(iter(fields))):
        replace(format_named("csv"), **fields)


def test_readers_by_ending(box):
    (export_format,) = reader_of("box.JSON").read(FILES / "box.json", None)
    assert (export_format.name, export_format.budget.kind) == (box.name, box.budget.kind)
    assert reader_of("contacts.CSV").options == ("friction", "task", "unit")
    assert reader_of("grasps.yml") is reader_of("grasps.yaml")
    assert reader_of("grasps.yml").options == ("problem",)

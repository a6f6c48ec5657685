"""Cache folder: corrupt and foreign entries, switching off, unwritable folders."""

import os
import stat

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common import cache
from nlpgrasp.common import user_warnings as once
from nlpgrasp.common.cache import cached_arrays

NUMBERS = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(0.5)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv("NLPGRASP_CACHE", str(path))
    monkeypatch.setattr(once, "_issued", set())
    return path


class Maker:
    """Counts how often it is asked."""

    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        return NUMBERS


def assert_same(arrays):
    assert arrays.keys() == NUMBERS.keys()
    for name, array in NUMBERS.items():
        np.testing.assert_array_equal(arrays[name], array)


def test_made_once_and_the_same_again(folder):
    make = Maker()
    for _ in range(3):
        assert_same(cached_arrays("test", [b"x"], make))
    assert make.calls == 1
    assert len(list(folder.iterdir())) == 1


def test_other_content_is_another_entry(folder):
    make = Maker()
    for parts in ([b"x"], [b"y"], [b"x", b""], [b"", b"x"]):
        cached_arrays("test", parts, make)
    cached_arrays("other", [b"x"], make)
    assert make.calls == 5


def test_other_code_or_libraries_make_another_entry(folder, monkeypatch):
    make = Maker()
    cached_arrays("test", [b"x"], make)
    monkeypatch.setattr(cache, "_source_of", lambda make: b"other code")
    cached_arrays("test", [b"x"], make)
    monkeypatch.setattr(cache, "_library_versions", lambda: ("999",))
    cached_arrays("test", [b"x"], make)
    assert make.calls == 3


@pytest.mark.parametrize(
    "spoil", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"foreign", lambda b: b[:-1] + b"x"]
)
def test_a_spoilt_entry_is_made_anew_and_said_once(folder, spoil):
    make = Maker()
    cached_arrays("test", [b"x"], make)
    (file,) = folder.iterdir()
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.warns(UserWarning, match="not a whole entry of the cache: it is made anew"):
        assert_same(cached_arrays("test", [b"x"], make))
    assert_same(cached_arrays("test", [b"x"], make))
    assert make.calls == 2


def test_a_folder_that_cannot_be_made_is_said_once(folder):
    folder.write_text("a file")
    make = Maker()
    with pytest.warns(UserWarning, match="going on without it"):
        assert_same(cached_arrays("test", [b"x"], make))
    assert_same(cached_arrays("test", [b"x"], make))  # a second warning would be an error
    assert make.calls == 2


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder(folder):
    folder.mkdir()
    folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.warns(UserWarning, match="cannot be written"):
        assert_same(cached_arrays("test", [b"x"], Maker()))


def test_a_full_disk(folder, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache, "write_bytes", full)
    with pytest.warns(UserWarning, match="No space left on device"):
        assert_same(cached_arrays("test", [b"x"], Maker()))


def test_it_can_be_switched_off(folder, monkeypatch):
    monkeypatch.setenv("NLPGRASP_CACHE", "off")
    make = Maker()
    for _ in range(2):
        assert_same(cached_arrays("test", [b"x"], make))
    assert make.calls == 2
    assert not folder.exists()


def test_the_oldest_entries_go_and_no_other_file(folder, monkeypatch):
    folder.mkdir()
    (folder / "letter.txt").write_text("mine")
    make = Maker()
    cached_arrays("test", [b"0"], make)
    size = next(f for f in folder.iterdir() if f.name != "letter.txt").stat().st_size
    monkeypatch.setattr(cache, "MOST", 3 * size + size // 2)
    for i in range(1, 6):
        for file in folder.iterdir():
            os.utime(file, (file.stat().st_mtime - 10.0,) * 2)
        cached_arrays("test", [str(i).encode()], make)
    assert len(list(folder.iterdir())) == 1 + 3
    assert (folder / "letter.txt").read_text() == "mine"
    cached_arrays("test", [b"5"], make)
    assert make.calls == 6


def kinds(folder):
    """Return the names of a folder's entries, sorted."""
    return sorted(file.name.split("-")[0] for file in folder.iterdir())


def test_a_mesh_that_differs_by_one_bit_is_another(folder):
    mesh = trimesh.creation.icosphere(2, 0.05)
    first = ng.Mesh(mesh)
    assert kinds(folder) == ["distance", "outer", "wall"]
    vertices = np.array(mesh.vertices)
    vertices[5, 0] = np.nextafter(vertices[5, 0], 1.0)
    ng.Mesh(trimesh.Trimesh(vertices, mesh.faces, process=False))
    assert kinds(folder) == 2 * ["distance"] + 2 * ["outer"] + 2 * ["wall"]
    second = ng.Mesh(mesh)
    assert kinds(folder) == 2 * ["distance"] + 2 * ["outer"] + 2 * ["wall"]
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (50, 3))
    np.testing.assert_array_equal(first.evaluate("surface", points)[0], second.evaluate("surface", points)[0])

"""Damaged files of every kind that is read: exceptions, crashes, seconds and memory.

``python -m benchmarks fuzz_files`` damages small valid files 500 times a kind, ``fuzz_files:urdf,mjcf`` those of two.
Each kind is read by processes of its own; a file may be read, or refused by an error of the package.
"""

from __future__ import annotations

import io
import json
import os
import re
import resource
import selectors
import shutil
import subprocess
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import perf_counter

import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.interop.grasp_arrays import CONVERTED

COUNT, SEED = 500, 0
ADDRESS_SPACE = 6 * 2**30  # bytes
TIME_OUT, WARM_UP = 30.0, 600.0  # s, after which a reader is killed; with its first file, the valid one
MOST_SECONDS, MOST_MEMORY = 2.0, 1024.0  # s of processors and MiB of a file
NUMBERS = (
    b"1e308",
    b"-1",
    b"99999999999999",
    b"4294967295",
    b"nan",
    b"inf",
    b"1e-320",
    b"0",
    b"0.5",
    b"3",
    b"1e-3",
    b"1" * 5000,
)
TEXTS = (
    b"<",
    b"&a [*a]",
    b"[" * 3000,
    b"{" * 3000,
    b"\0",
    b"\xc3\x28",
    b'"',
    b"'",
    b"\n",
    b",",
    b"<a>" * 3000,
    b"../" * 40,
)
COUNTS = (2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1, 10**7, 10**9)
POINTS = np.array([[[0.03, 0, 0], [-0.03, 0.02, 0], [-0.03, -0.02, 0]]] * 4)
NORMALS = np.array([[[-1.0, 0, 0], [1, 0, 0], [1, 0, 0]]] * 4)
URDF = """<robot name="two">
<link name="palm"><collision><geometry><box size="0.05 0.05 0.02"/></geometry></collision></link>
<link name="tip">
<collision><origin xyz="0 0 0.03" rpy="0 0 0"/><geometry><sphere radius="0.01"/></geometry></collision>
<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="other"><collision><geometry><cylinder radius="0.01" length="0.02"/></geometry></collision></link>
<joint name="bend" type="revolute"><parent link="palm"/><child link="tip"/><origin xyz="0.05 0 0" rpy="0 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5"/></joint>
<joint name="follow" type="revolute"><parent link="palm"/><child link="other"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1"/><mimic joint="bend" multiplier="1" offset="0"/></joint>
</robot>"""
MJCF = """<mujoco model="two"><compiler angle="radian"/><asset><hfield name="h" nrow="4" ncol="4" size="1 1 1 1"/>
<texture name="t" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0" rgb2="0 1 0"/>
<mesh name="m" vertex="0 0 0  .01 0 0  0 .01 0  0 0 .01"/></asset><worldbody><body name="palm">
<geom type="box" size=".05 .05 .01"/>
<body name="tip" pos=".1 0 0"><joint name="j" range="-1 1"/><geom size=".01"/></body>
<body name="other" pos="-.1 0 0"><joint name="k" range="-1 1"/><geom type="mesh" mesh="m"/></body></body></worldbody>
<actuator><motor joint="j" forcerange="-1 1" ctrlrange="-1 1"/></actuator>
<equality><joint joint1="k" joint2="j" polycoef="0 1 0 0 0"/></equality></mujoco>"""
PLACED = "confidence: 1.0, position: [0.0, 0.1, 0.2], orientation: {w: 1.0, xyz: [0.0, 0.0, 0.0]}"
ISAAC = f"""format: isaac_grasp
format_version: "1.0"
object_scale: 1.0
grasps:
  grasp_0: {{{PLACED}, cspace_position: {{j: 0.1}}}}
  grasp_1: {{{PLACED}, cspace_position: {{j: 0.2}}}}
"""


@dataclass(frozen=True)
class Kind:
    """A kind of file: its ending, the bytes of a valid one, and its reader."""

    ending: str
    valid: Callable[[], bytes]
    read: Callable[[Path], object]


def problem() -> ng.GraspProblem:
    """Return a small problem in the plane."""
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.1, 0])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, task)


def saved(name: str, save: Callable[[Path], object]) -> bytes:
    """Return the bytes of the file that a function writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        save(Path(folder))
        return next(Path(folder).rglob(name)).read_bytes()


def solution_bytes() -> bytes:
    """Return a solution file."""
    solution = ng.solve(problem(), starts=1, options=ng.SolveOptions(global_bound=False))
    return saved("s.json", lambda folder: solution.save(folder / "s.json"))


def bound_bytes() -> bytes:
    """Return a bound file."""
    best = ng.best_possible(problem(), gap=0.2, time_limit=5.0)
    return saved("b.json", lambda folder: best.save(folder / "b.json"))


def entry_bytes(name: str) -> bytes:
    """Return a file of a task library."""
    wrenches = np.random.default_rng(0).normal(size=(40, 6))
    return saved(name, lambda folder: ng.TaskLibrary(folder).add("w", wrenches))


def read_entry(path: Path) -> object:
    """Read an entry of a task library, of which one file is damaged."""
    library = path.parent / "library"
    if not library.is_dir():
        ng.TaskLibrary(library).add("w", np.random.default_rng(0).normal(size=(40, 6)))
    (stored,) = [file for file in library.glob(f"w*{path.suffix}") if file.suffix == path.suffix]
    kept = stored.read_bytes()
    try:
        shutil.copy(path, stored)
        entry = ng.TaskLibrary(library)["w"]
        return entry, ng.TaskLibrary(library).update("w", np.eye(6)) if path.suffix == ".npz" else None
    finally:
        shutil.rmtree(library) if path.suffix == ".npz" else stored.write_bytes(kept)


def npz_bytes(**arrays: object) -> bytes:
    """Return an npz file."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def npy_bytes() -> bytes:
    """Return a pickled record of a benchmark."""
    file = io.BytesIO()
    np.save(file, np.array({"points": POINTS, "normals": NORMALS}, dtype=object), allow_pickle=True)
    return file.getvalue()


def csv_bytes() -> bytes:
    """Return a table of contacts."""
    rows = [
        f"g{i},{','.join(map(str, [*p, *n]))},0.5"
        for i, (points, normals) in enumerate(zip(POINTS, NORMALS, strict=True))
        for p, n in zip(points, normals, strict=True)
    ]
    return "\n".join(["grasp,p_x,p_y,p_z,n_x,n_y,n_z,friction", *rows, ""]).encode()


def parquet_bytes() -> bytes:
    """Return a table of contacts in Parquet."""
    import pandas as pd

    file = io.BytesIO()
    pd.read_csv(io.BytesIO(csv_bytes())).to_parquet(file)
    return file.getvalue()


def hdf5_bytes() -> bytes:
    """Return arrays in HDF5."""
    from nlpgrasp.interop.benchmark_arrays import hdf5_bytes

    return hdf5_bytes({"contact_points": POINTS, "contact_normals": NORMALS})


def set_bytes() -> bytes:
    """Return the rows of a set of grasps."""
    make = lambda folder: ng.make_set({"a": problem()}, grasps_per_problem=2, simulate=False, out=folder / "set")  # noqa: E731
    return saved("a.parquet", make)


def read_set(path: Path) -> object:
    """Read a set of grasps whose rows are damaged."""
    folder = path.parent / "set"
    if not folder.is_dir():
        ng.make_set({"a": problem()}, grasps_per_problem=2, simulate=False, out=folder)
    shutil.copy(path, folder / "rows" / "a.parquet")
    grasps = ng.open_set(folder)
    return grasps.frame(), [grasps.solution(i) for i in range(len(grasps))]


def mesh_bytes(ending: str, **options: object) -> bytes:
    """Return a mesh of a box with a hole."""
    mesh = trimesh.creation.annulus(0.01, 0.03, 0.04, sections=12)
    if ending == "3mf":  # in millimetres
        mesh.apply_scale(1000.0)
    content = (
        trimesh.Scene(mesh).export(file_type=ending)
        if ending in ("3mf", "glb")
        else mesh.export(file_type=ending, **options)
    )
    return content.encode() if isinstance(content, str) else content


def gltf_bytes() -> bytes:
    """Return a glTF file with its buffers inside."""
    import base64

    files = trimesh.Scene(trimesh.creation.box([0.1, 0.05, 0.03])).export(file_type="gltf")
    data = json.loads(files.pop("model.gltf"))
    for buffer in data["buffers"]:
        buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(files[buffer["uri"]]).decode()
    return json.dumps(data).encode()


def read_mesh(path: Path) -> object:
    """Read a body from a mesh file."""
    return ng.Mesh.load(path)


def read_grasps(path: Path) -> object:
    """Read grasps."""
    return ng.read_grasps(path, friction=0.5)


def read_isaac(path: Path) -> object:
    """Read grasps of a gripper."""
    from nlpgrasp.interop import read_isaac_grasps

    return read_isaac_grasps(path)


def read_hand(path: Path) -> object:
    """Read a hand."""
    return ng.URDFHand.load(path, {"tip": ng.SphereTip(0.01, (0.0, 0.0, 0.03 if path.suffix == ".urdf" else 0.0))})


def wrench_csv() -> bytes:
    """Return a recording."""
    rows = np.random.default_rng(0).normal(size=(30, 6)).round(4).tolist()
    return "\n".join(["fx [N],fy [N],fz [N],mx [Nm],my [Nm],mz [Nm]", *(",".join(map(str, r)) for r in rows)]).encode()


KINDS = {
    "npy": Kind(".npy", npy_bytes, read_grasps),
    "npz": Kind(".npz", lambda: npz_bytes(points=POINTS, normals=NORMALS, ids=np.array(list("abcd"))), read_grasps),
    "csv": Kind(".csv", csv_bytes, read_grasps),
    "parquet": Kind(".parquet", parquet_bytes, read_grasps),
    "yaml": Kind(".yaml", ISAAC.encode, read_isaac),
    "hdf5": Kind(".h5", hdf5_bytes, read_grasps),
    "solution": Kind(".json", solution_bytes, ng.verify),
    "bound": Kind(".json", bound_bytes, ng.verify),
    "bound_loaded": Kind(".json", bound_bytes, ng.BestPossible.load),
    "task": Kind(".json", lambda: entry_bytes("w.json"), read_entry),
    "wrenches": Kind(".npz", lambda: entry_bytes("w-*.npz"), read_entry),
    "recording": Kind(".csv", wrench_csv, ng.WrenchRecording.read),
    "set": Kind(".parquet", set_bytes, read_set),
    "urdf": Kind(".urdf", URDF.encode, read_hand),
    "mjcf": Kind(".xml", MJCF.encode, read_hand),
    "stl": Kind(".stl", lambda: mesh_bytes("stl"), read_mesh),
    "stl_ascii": Kind(".stl", lambda: mesh_bytes("stl_ascii"), read_mesh),
    "obj": Kind(".obj", lambda: mesh_bytes("obj"), read_mesh),
    "ply": Kind(".ply", lambda: mesh_bytes("ply"), read_mesh),
    "ply_ascii": Kind(".ply", lambda: mesh_bytes("ply", encoding="ascii"), read_mesh),
    "off": Kind(".off", lambda: mesh_bytes("off"), read_mesh),
    "glb": Kind(".glb", lambda: mesh_bytes("glb"), read_mesh),
    "gltf": Kind(".gltf", gltf_bytes, read_mesh),
    "3mf": Kind(".3mf", lambda: mesh_bytes("3mf"), read_mesh),
    "dae": Kind(".dae", lambda: mesh_bytes("dae"), read_mesh),
}


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Return content with one to three random changes; those of an archive are also made inside it."""
    if content[:2] == b"PK" and rng.random() < 0.7:
        return _damaged_archive(content, rng)
    for _ in range(rng.choice((1, 1, 2, 3))):
        content = _changed(bytearray(content), rng)
    return content


def _changed(data: bytearray, rng: np.random.Generator) -> bytes:
    """Return content with one random change."""
    place, kind = int(rng.integers(len(data) + 1)), rng.integers(11)
    length = int(rng.integers(1, 1 + max(1, len(data) // 4)))
    if kind == 0:  # flipped bits
        for i in rng.integers(len(data), size=rng.integers(1, 20)) if data else ():
            data[i] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        del data[place:]
    elif kind == 2:
        del data[place : place + length]
    elif kind == 3:  # a piece again
        data[place:place] = data[max(0, place - length) : place]
    elif kind == 4:  # a large whole number in binary
        number = COUNTS[rng.integers(len(COUNTS))]
        size = 4 if number < 2**32 else 8
        data[place : place + size] = number.to_bytes(size, "little" if rng.random() < 0.8 else "big")
    elif kind == 5:
        data[place:place] = TEXTS[rng.integers(len(TEXTS))]
    elif found := list(re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", data)):  # another number in text
        start, end = found[rng.integers(len(found))].span()
        data[start:end] = NUMBERS[rng.integers(len(NUMBERS))]
    return bytes(data)


def _damaged_archive(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a zip archive with a damaged member."""
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as result:
        names = archive.namelist()
        chosen = names[rng.integers(len(names))]
        for name in names:
            data = archive.read(name)
            result.writestr(name, _changed(bytearray(data), rng) if name == chosen else data)
    return file.getvalue()


def child(name: str) -> None:
    """Read the files whose paths come in, and print what came of each."""
    warnings.simplefilter("ignore")
    import_module("manifold3d")
    kind = KINDS[name]
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what libraries print
    for line in sys.stdin:
        path = Path(line.strip())
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
        before, start, outcome = _memory("VmRSS"), sum(os.times()[:4]), "read"
        try:
            kind.read(path)
        except ng.NlpgraspError as error:
            outcome = f"refused: {error}"
        except BaseException as error:
            outcome = f"TRACEBACK {type(error).__name__}: {error}"
        print(json.dumps([outcome, sum(os.times()[:4]) - start, _memory("VmHWM") - before]), file=answers, flush=True)


def _memory(key: str) -> float:
    """Return a figure of this process's memory, MiB."""
    text = Path("/proc/self/status").read_text()
    return int(re.search(rf"{key}:\s+(\d+)", text).group(1)) / 1024


class Reader:
    """A process that reads files of one kind, begun anew when a file ends it."""

    def __init__(self, kind: str) -> None:
        self.kind, self.process = kind, None

    def read(self, path: Path, time_out: float = TIME_OUT) -> tuple[str, float, float]:
        """Return the outcome, seconds and MiB of reading a file."""
        if self.process is None:
            command = [sys.executable, "-m", "benchmarks.fuzz_files", "--child", self.kind]
            self.process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
        start = perf_counter()
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            if selector.select(timeout=time_out) and (line := self.process.stdout.readline()):
                return tuple(json.loads(line))
        self.process.kill()
        code = self.close()
        return f"CRASH or more than {time_out:.0f} s (code {code})", perf_counter() - start, 0.0

    def close(self) -> int | None:
        """End the process and return its code."""
        if self.process is None:
            return None
        with self.process as process:
            process.stdin.close()
        self.process = None
        return process.returncode


def fuzz(name: str, count: int = COUNT, seed: int = SEED, keep: Path | None = None) -> dict[str, object]:
    """Return what came of damaged files of a kind: numbers read and refused, faults, and the largest time and memory.

    Faults are exceptions that are not the package's, and crashes; files of more than 2 s or 1 GiB are costly. A folder
    keeps such files.
    """
    kind, reader = KINDS[name], Reader(name)
    rng, valid = np.random.default_rng([seed, *name.encode()]), kind.valid()
    faults, costly, outcomes, worst = [], [], [], [0.0, 0.0]
    with tempfile.TemporaryDirectory() as folder:
        for i in range(-1, count):  # the first is the valid file, which warms up
            path = Path(folder) / f"{max(i, 0)}{kind.ending}"
            path.write_bytes(valid if i < 0 else damaged(valid, rng))
            outcome, seconds, memory = reader.read(path, WARM_UP if i < 0 else TIME_OUT)
            if i < 0:
                if outcome != "read" and kind.ending not in CONVERTED:
                    raise SystemExit(f"{name}: the valid file is not read: {outcome}")
                continue
            outcomes.append(outcome.split(":")[0])
            worst = [max(worst[0], seconds), max(worst[1], memory)]
            is_fault = outcomes[-1] not in ("read", "refused")
            if is_fault or seconds > MOST_SECONDS or memory > MOST_MEMORY:
                listed = faults if is_fault else costly
                listed.append(f"{name} {i}: {seconds:.1f} s, {memory:.0f} MiB, {outcome[:200]}")
                if keep is not None:
                    shutil.copy(path, keep / f"{name}-{path.name}")
            path.unlink()
    reader.close()
    counts = {outcome: outcomes.count(outcome) for outcome in ("read", "refused")}
    return {"kind": name, **counts, "faults": faults, "costly": costly, "seconds": worst[0], "MiB": worst[1]}


def run(kinds: str = "", count: str = str(COUNT)) -> None:
    """Print a row a kind, and each fault."""
    keep = Path(tempfile.mkdtemp(prefix="fuzz-"))
    print(f"faults are kept in {keep}")
    print(f"{'kind':14}{'read':>6}{'refused':>9}{'faults':>8}{'costly':>8}{'most s':>8}{'most MiB':>10}")
    for name in kinds.split(",") if kinds else KINDS:
        row = fuzz(name, int(count), keep=keep)
        counts = f"{row['read']:6}{row['refused']:9}{len(row['faults']):8}{len(row['costly']):8}"
        print(f"{name:14}{counts}{row['seconds']:8.2f}{row['MiB']:10.0f}", flush=True)
        for fault in (*row["faults"], *row["costly"]):
            print(f"  {fault}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2])
    else:
        run(*sys.argv[1:])

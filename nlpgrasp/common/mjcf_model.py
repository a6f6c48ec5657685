"""Compilation of MJCF files by MuJoCo, first in a process of its own, as a damaged file can crash it."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from nlpgrasp.common.optional_packages import import_mujoco, mjcf_spec
from nlpgrasp.common.robot_files import LARGEST_XML

if TYPE_CHECKING:
    from mujoco import MjModel

MEMORY, SECONDS = 1024**3, 20  # bytes and time of the process
ERROR = "nlpgrasp: "  # begins a message of the process
PROGRAM = f"""
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except ImportError:  # on Windows
    pass
import mujoco
from pathlib import Path
from nlpgrasp.common.optional_packages import mjcf_spec
try:
    spec = mjcf_spec(Path(sys.argv[1]))
    spec.compiler.fusestatic = False
    mujoco.mj_saveModel(spec.compile(), sys.argv[2])
except Exception as error:
    sys.exit("{ERROR}" + " ".join(str(error).split()))
"""

_compiled = set[str]()  # SHA-256 of the files that such a process compiled; from then on this process compiles them


def compile_model(path: Path) -> MjModel:
    """Return MuJoCo's model of an MJCF file, with each body as a separate link.

    Raises
    ------
    ValueError
        When the file is too large, or MuJoCo cannot read it, crashes, or takes too much memory or time.
    OSError
        When the file cannot be read.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    mujoco = import_mujoco(f"{path.name}: reading MJCF")
    if path.stat().st_size > LARGEST_XML:
        raise ValueError(f"more than {LARGEST_XML // 2**20} MiB")
    file, digest = os.path.abspath(path), hashlib.sha256(path.read_bytes()).hexdigest()
    if digest in _compiled:
        try:
            spec = mjcf_spec(Path(file))
            spec.compiler.fusestatic = False  # every body stays a separate link
            return spec.compile()
        except mujoco.FatalError as error:
            raise ValueError(str(error)) from None
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        target = os.path.join(folder, "model.mjb")
        _run_apart(file, target, folder)
        model = mujoco.MjModel.from_binary_path(target)
    _compiled.add(digest)
    return model


def _run_apart(file: str, target: str, folder: str) -> None:
    """Compile a file in a process of its own, into a binary file; raise ``ValueError`` if that fails."""
    command = [sys.executable, "-P", "-c", PROGRAM, file, target]
    variables = {**os.environ, "MUJOCO_GL": "disable"}  # nothing is drawn
    try:
        done = subprocess.run(  # noqa: S603  (this interpreter, no shell)
            command, cwd=folder, env=variables, capture_output=True, text=True, errors="replace", timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        raise ValueError(f"MuJoCo takes more than {SECONDS} s to read it") from None
    if done.returncode:
        _, is_stated, message = done.stderr.rpartition(ERROR)
        raise ValueError(message.strip() if is_stated else f"MuJoCo ends with code {done.returncode} on it")

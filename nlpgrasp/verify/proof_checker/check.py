"""Check of a proof file by the checker in C, or by the one in Python where there is no compiler."""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Literal

from nlpgrasp.common.cache import folder
from nlpgrasp.errors import InputError
from nlpgrasp.verify.proof_checker.exact_checker import NotProvedError, check

PROVED = re.compile(r"PROVED: (\S+) <= mu <= (\S+)\n")
TIME_LIMIT = 600.0  # s, of a check


@dataclass(frozen=True)
class CheckedProof:
    """Result of a check: the proved interval, or the step that does not hold.

    Parameters
    ----------
    lower, upper : float
        ``lower <= mu <= upper``; 0 and infinity where nothing is proved.
    reason : str
        The first step that does not hold; empty if the proof holds.
    checker : str
        ``"c"`` or ``"python"``.
    """

    lower: float
    upper: float
    reason: str
    checker: Literal["c", "python"]

    def __bool__(self) -> bool:
        return not self.reason

    def __str__(self) -> str:
        if self.reason:
            return f"NOT PROVED: {self.reason}"
        by = "interval arithmetic" if self.checker == "c" else "rational arithmetic"
        return f"PROVED in {by}: {self.lower!r} <= mu <= {self.upper!r}"


def check_proof(proof: str | Path | bytes, checker: Literal["c", "python"] | None = None) -> CheckedProof:
    """Check a proof file (docs/proof_format.md), which stands alone.

    Parameters
    ----------
    proof : str, Path or bytes
        Proof file, or its content.
    checker : {"c", "python"}, optional
        ``checker.c``, built once by the machine's compiler, or ``exact_checker.py``, some hundred times slower; by
        default the first, where there is a compiler.

    Raises
    ------
    InputError
        When the file cannot be read, or the checker in C is requested and there is no compiler.
    """
    if checker not in (None, "c", "python"):
        raise InputError("checker", checker, '"c" or "python"')
    data = proof if isinstance(proof, bytes) else read_proof(proof)
    header = re.match(rb"\s*nlpgrasp-proof\s+(\S+)", data)
    version = "" if header is None else header[1][:20].decode("ascii", "replace")
    if version != "1":
        found = f"version {version}" if version else "a file that does not begin with nlpgrasp-proof"
        return CheckedProof(0.0, float("inf"), f"{found}, expected a proof of version 1", checker or "c")
    program = None if checker == "python" else compiled_checker()
    if program is not None:
        try:
            done = subprocess.run([program], input=data, capture_output=True, timeout=TIME_LIMIT, check=False)  # noqa: S603
        except subprocess.TimeoutExpired:
            return CheckedProof(0.0, float("inf"), f"the checker took more than {TIME_LIMIT:g} s", "c")
        answer = PROVED.fullmatch(done.stdout.decode("ascii", "replace"))
        if done.returncode == 0 and answer is not None:
            return CheckedProof(float(answer[1]), float(answer[2]), "", "c")
        said = done.stdout.decode("ascii", "replace").strip().removeprefix("NOT PROVED: ")
        return CheckedProof(0.0, float("inf"), said or f"the checker ended with code {done.returncode}", "c")
    if checker == "c":
        raise InputError("checker", "c", '"python", or a C compiler named cc, gcc or clang on the PATH')
    try:
        lower, upper = check(data)
    except NotProvedError as error:
        return CheckedProof(0.0, float("inf"), str(error), "python")
    return CheckedProof(lower, upper, "", "python")


def read_proof(path: str | Path) -> bytes:
    """Return the content of a proof file; raise an ``InputError`` if it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"proof ({path})", error.strerror, "a proof file that can be read") from None


def compiled_checker() -> Path | None:
    """Return the compiled checker, built once in the cache folder, or once a process; None without a compiler."""
    source = resources.files("nlpgrasp.verify.proof_checker").joinpath("checker.c").read_bytes()
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    name = f"proof-checker-{hashlib.sha256(source).hexdigest()[:16]}"
    for find_place in (folder, _private_folder):
        place = find_place()
        if place is not None and (place / name).exists():
            return place / name
        if place is not None and compiler is not None and _build(source, compiler, place / name):
            return place / name
    return None


def _build(source: bytes, compiler: str, program: Path) -> bool:
    """Build the checker, and return whether that succeeded."""
    try:
        program.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=program.parent) as work:
            file, built = Path(work) / "checker.c", Path(work) / "checker"
            file.write_bytes(source)
            command = [compiler, "-O3", "-o", str(built), str(file), "-lm"]
            if subprocess.run(command, capture_output=True, check=False).returncode != 0:  # noqa: S603
                return False
            os.replace(built, program)
    except OSError:  # a cache folder that cannot be written
        return False
    return True


@cache
def _private_folder() -> Path:
    """Return a folder that other users cannot write, removed when the process ends."""
    private = tempfile.TemporaryDirectory(prefix="nlpgrasp-")
    atexit.register(private.cleanup)
    return Path(private.name)

"""Lies in proof files, and damaged proof files: none is accepted unless it is true, none crashes or stalls a checker.

``python -m benchmarks proof_lies:lies:300`` edits proofs and asks both checkers; what one of them accepts is compared
with the claim itself by conic programs. ``proof_lies:fuzz:3600`` damages proofs at random for 3600 s, and
``proof_lies:libfuzzer:3600`` lets libFuzzer do so, which takes clang. The checker in C is built with
``-fsanitize=address,undefined``.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import clarabel
import numpy as np
from scipy import sparse

import nlpgrasp as ng
from benchmarks.fuzz_files import damaged
from nlpgrasp.common.quadratic_program import cone_of, quiet_settings
from nlpgrasp.quality.proof import prove
from nlpgrasp.verify.proof_checker.exact_checker import NotProvedError, check

WORDS = ("coordinates", "origin", "contacts", "variables", "lift", "cones", "task", "bounds", "upper", "lower")
NUMBERS = (
    "0",
    "-0.0",
    "-1",
    "0.5",
    "1e308",
    "-1e308",
    "5e-324",
    "nan",
    "inf",
    "1e999",
    "4294967296",
    "16777217",
    "7",
    "x",
)
SECONDS, MEMORY = 10, 1024  # most of a file, seconds and MiB
STARTS, STEPS = 20, 25  # of the search for a direction that contradicts a lower bound
# a process for each file named on standard input; one line each: signal and code, seconds, MiB
SERVER = r"""
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>
#define main checker
#include "checker.c"
#undef main
int main(void) {
  char path[4096], out[8] = {0}; struct rusage used; int status, pipes[2];
  while (fgets(path, sizeof path, stdin)) {
    path[strcspn(path, "\n")] = 0; if (pipe(pipes)) return 1; fflush(stdout);
    if (!fork()) { alarm(SECONDS); dup2(pipes[1], 1); if (!freopen(path, "rb", stdin)) _exit(9); exit(checker()); }
    close(pipes[1]); memset(out, 0, sizeof out); if (read(pipes[0], out, 6) < 0) return 1;
    wait4(-1, &status, 0, &used); close(pipes[0]);
    printf("%d %d %.3f %ld %s\n", WIFSIGNALED(status) ? WTERMSIG(status) : 0, WEXITSTATUS(status),
      used.ru_utime.tv_sec + used.ru_utime.tv_usec / 1e6, used.ru_maxrss / 1024, out); fflush(stdout);
  }
}
"""
# the checker as a function for libFuzzer, which keeps what is proved
FUZZER = r"""
#include <setjmp.h>
#include <stdlib.h>
static jmp_buf end; static void *kept[4096]; static int keeps;
static void *keep(void *p) { return kept[keeps++] = p; }
#define exit(code) longjmp(end, code)
#define calloc(count, size) keep(calloc(count, size))
#define main checker
#include "checker.c"
int LLVMFuzzerTestOneInput(const unsigned char *data, size_t size) {
  static int proved; char name[64]; if (!size) return 0;
  stdin = fmemopen((void *)data, size, "rb"); n = rows = cells = 0;
  if (!setjmp(end) && !checker() && proved < 10000) {
    snprintf(name, sizeof name, "proved/%d", proved++);
    FILE *file = fopen(name, "wb"); fwrite(data, 1, size, file); fclose(file);
  }
  fclose(stdin); while (keeps) free(kept[--keeps]);
  return 0;
}
"""


class Checker:
    """The checker in C with sanitizers, for one file after another."""

    def __init__(self, folder: Path) -> None:
        source = resources.files("nlpgrasp.verify.proof_checker").joinpath("checker.c")
        (folder / "checker.c").write_bytes(source.read_bytes())
        (folder / "server.c").write_text(SERVER.replace("SECONDS", str(SECONDS)))
        flags = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
        subprocess.run(["cc", *flags, "-o", folder / "server", folder / "server.c", "-lm"], check=True)
        self.path = folder / "checked.proof"
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": (folder / "sanitizers.txt").open("w")}
        options = {"ASAN_OPTIONS": "detect_leaks=0"}  # the program ends without freeing
        self._process = subprocess.Popen([folder / "server"], text=True, env=options, **pipes)

    def check(self, data: bytes) -> tuple[bool, str, float, int]:
        """Return whether a file is proved, a fault or an empty text, seconds, and MiB."""
        self.path.write_bytes(data)
        self._process.stdin.write(f"{self.path}\n")
        self._process.stdin.flush()
        signal, code, seconds, memory, *said = self._process.stdout.readline().split()
        is_proved = code == "0" and signal == "0" and said == ["PROVED"]
        fault = f"signal {signal}, code {code}" if signal != "0" or code not in ("0", "1") else ""
        if int(memory) > MEMORY:
            fault += f" {memory} MiB"
        return is_proved, fault, float(seconds), int(memory)


class Claim:
    """What a proof file says, read without the checkers."""

    def __init__(self, data: bytes) -> None:
        end = data.find(b"\n", data.find(b"\nlower") + 1)
        words = iter(data[:end].decode("ascii").split())

        def take(count: int) -> np.ndarray:
            return np.array([float(next(words)) for _ in range(count)])

        def matrix(rows: int, columns: int) -> np.ndarray:
            dense = np.zeros((rows, columns))
            for row, column, value in take(3 * int(take(1)[0])).reshape(-1, 3):
                dense[int(row), int(column)] += value
            return dense

        next(words), take(1), next(words)
        used = take(int(take(1)[0])).astype(int)
        next(words)
        origin = take(3)
        next(words)
        wrenches = []
        for _ in range(int(take(1)[0])):
            arm, frame = take(3) - origin, take(9).reshape(3, 3)
            for component in take(int(take(1)[0])).astype(int):
                axis = frame[component % 3]
                full = np.r_[axis, np.cross(arm, axis)] if component < 3 else np.r_[np.zeros(3), axis]
                wrenches.append(full[used])
        next(words)
        variables = int(take(1)[0])
        next(words)
        self.map = np.array(wrenches).T @ matrix(len(wrenches), variables)
        next(words)
        sizes = take(int(take(1)[0])).astype(int)
        blocks = np.split(matrix(int(sizes.sum()), variables + 1), np.cumsum(sizes)[:-1])
        self.cones = [M / max(np.max(np.abs(M)), 1e-300) for M in blocks]  # of any size, for the solver
        next(words)
        self.task = []
        for _ in range(int(take(1)[0])):
            is_polytope, rows = take(2)
            self.task.append((bool(is_polytope), take(6 * int(rows)).reshape(-1, 6)[:, used]))
        next(words)
        self.lower, self.upper = take(2)
        next(words)
        self.direction = take(6)[used]

    def ratio(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the ratio of the supports of W and of the task along a direction, and its gradient."""
        rows = np.concatenate(self.cones)
        program = clarabel.DefaultSolver(
            sparse.csc_matrix((self.map.shape[1],) * 2), -(self.map.T @ y), sparse.csc_matrix(-rows[:, :-1]),
            rows[:, -1], [cone_of(cone) for cone in self.cones], quiet_settings(1e-10, 0.99),
        )  # fmt: skip
        solution = program.solve()
        wrench, demand = self.map @ np.array(solution.x), np.zeros(len(y))
        for is_polytope, part in self.task:
            work = part @ y
            length = np.linalg.norm(work[1:])
            ellipsoid = part[0] + (work[1:] / length) @ part[1:] if length > 0.0 else part[0]
            demand = demand + (part[np.argmax(work)] if is_polytope else ellipsoid)
        reach, is_solved = demand @ y, str(solution.status) in ("Solved", "AlmostSolved")
        if not is_solved or reach <= 0.0:
            return np.inf, np.zeros(len(y))
        value = wrench @ y / reach
        return float(value), (wrench - value * demand) / reach

    def is_true(self, seed: int = 0) -> bool:
        """Return whether no direction contradicts the lower bound, and the stated one confirms the upper bound."""
        rng = np.random.default_rng(seed)
        least = self.ratio(self.direction)[0]
        if least > self.upper * (1.0 + 1e-7):
            return False
        for y in [self.direction, *rng.normal(size=(STARTS, len(self.direction)))]:
            value, gradient = self.ratio(y)
            step = 1.0
            for _ in range(STEPS):
                trial = y - step * gradient * (y @ y) / max(value, 1e-300)
                new, slope = self.ratio(trial)
                if new < value:
                    y, value, gradient, step = trial, new, slope, 2.0 * step
                else:
                    step *= 0.3
            least = min(least, value)
        return least >= self.lower * (1.0 - 1e-7)


class Parts:
    """A proof file in parts that can be edited: words of its text by section, and doubles."""

    def __init__(self, data: bytes) -> None:
        end = data.find(b"\n", data.find(b"\nlower") + 1)
        self.sections: dict[str, list[str]] = {"nlpgrasp-proof": []}
        for word in data[:end].decode("ascii").split()[1:]:
            if word in WORDS:
                section = self.sections[word] = []
            else:
                (section if len(self.sections) > 1 else self.sections["nlpgrasp-proof"]).append(word)
        self.variables = np.frombuffer(data[end + 1 :], "<f8").reshape(-1, int(self.sections["variables"][0])).copy()

    def to_bytes(self) -> bytes:
        """Return the file."""
        self.sections["lower"][:1] = self.sections["lower"][:1] or [str(len(self.variables))]
        lines = [" ".join([name, *words]) for name, words in self.sections.items()]
        return ("\n".join(lines) + "\n").encode() + self.variables.astype("<f8").tobytes()


def scaled(words: list[str], place: int, factor: float) -> None:
    """Multiply a word by a factor."""
    words[place] = repr(float(words[place]) * factor)


def lie(parts: Parts, rng: np.random.Generator) -> str:
    """Change a proof so that it claims more, or proves less than it claims; return what was changed."""
    sections, u = parts.sections, parts.variables
    size = 10.0 ** rng.uniform(-8.0, 0.0)

    def raise_bounds() -> None:
        scaled(sections["bounds"], 0, 1.0 + size)
        scaled(sections["bounds"], 1, max(1.0 + size, 1.0))

    def lower_upper() -> None:
        scaled(sections["bounds"], 1, 1.0 / (1.0 + size))
        scaled(sections["bounds"], 0, 1.0 / (1.0 + size))

    def bounds() -> None:
        (raise_bounds if rng.random() < 0.5 else lower_upper)()

    def stated_bounds() -> None:
        sections["bounds"][rng.integers(2)] = str(rng.choice(NUMBERS))

    def forces() -> None:
        raise_bounds()
        rows = rng.integers(len(u), size=rng.integers(1, len(u)))
        kind = rng.integers(5)
        if kind == 0:
            u[:] *= 1.0 + size
        elif kind == 1:
            u[rows] *= 1.0 + 10.0 * size
        elif kind == 2:
            u[rows] += size * rng.normal(size=u[rows].shape)
        elif kind == 3:
            u[rows, rng.integers(u.shape[1])] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 5e-324])
        else:
            u[rows] = -u[rows]

    def vertices() -> None:
        raise_bounds()
        kind = rng.integers(6)
        if kind == 0:
            u[: u.shape[1] + 1] = u[0]
        elif kind == 1:
            u[:] = u[rng.integers(len(u), size=len(u))]
        elif kind == 2:
            rng.shuffle(u)
        elif kind == 3:
            u[:] = 0.0
        elif kind == 4:
            parts.variables = u[: rng.integers(len(u))]
            sections["lower"][0] = str(len(parts.variables))
        else:
            sections["lower"][0] = str(len(u) + int(rng.integers(-3, 4)))

    def normals() -> None:
        raise_bounds()
        words = sections["contacts"]
        for _ in range(rng.integers(1, 4)):
            scaled(words, int(rng.integers(4, 13)), 1.0 + size)

    def places() -> None:
        words = sections["contacts" if rng.random() < 0.7 else "origin"]
        place = int(rng.integers(len(words)))
        words[place] = repr(float(words[place]) + size) if rng.random() < 0.7 else str(rng.choice(NUMBERS))

    def frictions() -> None:
        if rng.random() < 0.5:
            raise_bounds()
        words = sections["cones"]
        scaled(words, int(rng.integers(1, len(words))), 1.0 + size)

    def entries() -> None:
        words = sections["lift" if rng.random() < 0.3 else "cones"]
        kind, start = rng.integers(4), len(words) - 3 * int(rng.integers(1, max(2, (len(words) - 2) // 3)))
        bounds()
        if kind == 0:
            words[rng.integers(len(words))] = str(rng.choice(NUMBERS))
        elif kind == 1:
            words[start : start + 3] = []
        elif kind == 2:
            words[start:start] = words[start : start + 3]
        else:
            words[start + int(rng.integers(2))] = str(int(rng.integers(-1, 40)))

    def multipliers() -> None:
        lower_upper()
        words, kind = sections["upper"], rng.integers(5)
        if kind == 0:
            words[:6] = ["0"] * 6
        elif kind == 1:
            scaled(words, int(rng.integers(len(words) - 2 * u.shape[1])), 1.0 - size)
        elif kind == 2:
            words[: len(words) - 2 * u.shape[1]] = ["0"] * (len(words) - 2 * u.shape[1])
        elif kind == 3:
            words[: len(words) - 2 * u.shape[1]] = [repr(-float(word)) for word in words[: len(words) - 2 * u.shape[1]]]
        else:
            words[rng.integers(len(words))] = str(rng.choice(NUMBERS))

    def pivots() -> None:
        lower_upper()
        words, count = sections["upper"], 2 * u.shape[1]
        words[len(words) - int(rng.integers(1, count + 1))] = str(int(rng.integers(-1, 30)))

    def task() -> None:
        raise_bounds()
        words = sections["task"]
        place = int(rng.integers(len(words)))
        words[place] = (
            str(rng.choice(NUMBERS)) if rng.random() < 0.5 else repr(float(words[place]) * (1.0 - 0.5 * size))
        )

    def counts() -> None:
        name = str(rng.choice(["contacts", "variables", "lift", "cones", "task", "lower", "coordinates"]))
        sections[name][0] = str(
            rng.choice(["1e9", "4294967296", "-1", "16777216", "1048576", "4096", "0.5", "0", "1e308"])
        )

    kinds: list[Callable[[], None]] = [
        bounds, stated_bounds, forces, vertices, normals, places, frictions, entries, multipliers, pivots, task, counts,
    ]  # fmt: skip
    chosen = kinds[rng.integers(len(kinds))]
    chosen()
    return chosen.__name__


def proofs() -> list[bytes]:
    """Return small proofs of several kinds."""
    flat = ([[-1, 0], [1, 0.1], [0, 1.0]], [[1, 0], [-1, 0], [0, -1.0]])
    box = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
    inward = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
    planar, spatial = ng.TaskEllipsoid([1, 1, 0.5]), ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
    corners = ng.TaskPolytope([[1, 0, 0.1], [-1, 0, 0], [0, 1, 0]]) + planar
    cases = [
        (ng.Grasp(*flat, ng.FrictionContact(0.5)), planar, 0.1, "l2"),
        (ng.Grasp(*flat, ng.LineContact(0.1, 0.5)), corners, 0.2, "shared"),
        (ng.Grasp(*flat, ng.FrictionContact(0.5)), ng.TaskPolytope([[1, 0, 0.1], [0, 1, 0]]), 0.2, "per_finger"),
        (ng.Grasp(box, inward, ng.FrictionContact(0.6)), spatial, 0.6, "per_finger_size"),
        (ng.Grasp(box, inward, ng.SoftContact(0.6, 0.01)), spatial, 1.0, "l2"),
    ]
    return [prove(*case).to_bytes() for case in cases]


def is_proved_exactly(data: bytes) -> tuple[bool, str]:
    """Return whether the exact checker proves a file, and a fault or an empty text."""
    try:
        check(data)
    except NotProvedError:
        return False, ""
    except Exception as error:
        return False, f"{type(error).__name__}: {error}"
    return True, ""


def judged(data: bytes) -> str:
    """Return whether what a file claims is true."""
    try:
        return "true" if Claim(data).is_true() else "FALSE"
    except (ValueError, IndexError, StopIteration) as error:
        return f"unreadable ({type(error).__name__}: {error})"


def lies(count: int, folder: Path) -> None:
    """Print what both checkers say of lies, and each fault."""
    checker, originals = Checker(folder), proofs()
    assert all(checker.check(data)[0] and is_proved_exactly(data)[0] for data in originals)
    table: dict[str, Counter[str]] = {}
    faults = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        parts = Parts(originals[seed % len(originals)])
        kind = lie(parts, rng)
        data = parts.to_bytes()
        if rng.random() < 0.1:
            kind, data = "truncated", data[: rng.integers(len(data))]
        is_proved, fault, _, _ = checker.check(data)
        is_exact, error = is_proved_exactly(data)
        row = table.setdefault(kind, Counter())
        row["lies"] += 1
        row["refused"] += not (is_proved or is_exact)
        row["differ"] += is_proved != is_exact
        if is_proved or is_exact:
            truth = judged(data)
            row[truth] += 1
            faults += [f"lie {seed}, {kind}: accepted, {truth}"] if truth != "true" else []
        faults += [f"lie {seed}, {kind}: {text}" for text in (fault, error) if text]
        if fault or error:
            shutil.copy(checker.path, folder / f"lie_{seed}.proof")
    print(f"{'lies':16}{'':6}{'refused':>9}{'true':>6}{'false':>7}{'checkers differ':>17}")
    for kind, row in sorted(table.items()):
        print(f"{kind:16}{row['lies']:6}{row['refused']:9}{row['true']:6}{row['FALSE']:7}{row['differ']:17}")
    print(*faults, sep="\n")


def fuzz(seconds: int, folder: Path) -> None:
    """Print files a second, what was proved, the longest seconds and most memory of a file, and each fault."""
    checker, originals = Checker(folder), proofs()
    rng, end = np.random.default_rng(0), time.monotonic() + seconds
    count, longest, most, outcomes, faults = 0, 0.0, 0, Counter(), []
    while time.monotonic() < end:
        data = originals[rng.integers(len(originals))]
        if rng.random() < 0.5:
            parts = Parts(data)
            for _ in range(rng.integers(1, 4)):
                try:
                    lie(parts, rng)
                except (ValueError, IndexError, OverflowError):  # of a number that an earlier lie made a word
                    break
            data = parts.to_bytes()
        if rng.random() < 0.7:
            data = damaged(data, rng)
        is_proved, fault, used, memory = checker.check(data)
        count, longest, most = count + 1, max(longest, used), max(most, memory)
        outcomes["proved" if is_proved else "refused"] += 1
        if is_proved and (truth := judged(data)) != "true":
            fault += f" accepted, {truth}"
        if fault:
            faults.append(f"file {count}: {fault}")
            (folder / f"fuzz_{count}.proof").write_bytes(data)
    print(f"{count} files in {seconds} s, {dict(outcomes)}; longest {longest:.1f} s, most {most} MiB")
    print(*faults, sep="\n")


def libfuzzer(seconds: int, folder: Path) -> None:
    """Print the end of libFuzzer's report, which follows coverage, and whether what was proved is true."""
    Checker(folder)
    (folder / "fuzzer.c").write_text(FUZZER)
    for name in ("corpus", "proved"):
        (folder / name).mkdir()
    for i, data in enumerate(proofs()):
        (folder / "corpus" / str(i)).write_bytes(data)
    (folder / "words").write_text("".join(f'"{word} "\n' for word in (*WORDS, *NUMBERS)))
    flags = ["-O1", "-g", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all"]
    clang = next(filter(None, map(shutil.which, ("clang", "clang-19", "clang-14"))))
    subprocess.run([clang, *flags, "-o", folder / "fuzzer", folder / "fuzzer.c", "-lm"], check=True)
    limits = [f"-max_total_time={seconds}", f"-timeout={SECONDS}", f"-rss_limit_mb={MEMORY}", "-malloc_limit_mb=4096"]
    options = ["-dict=words", "-max_len=16384", "-close_fd_mask=1", "-detect_leaks=0", "-print_final_stats=1"]
    done = subprocess.run([folder / "fuzzer", *limits, *options, "corpus"], cwd=folder, capture_output=True, text=True)
    print(*done.stderr.splitlines()[-12:], sep="\n")
    proved = sorted((folder / "proved").iterdir())
    truths = {path.name: judged(path.read_bytes()) for path in proved}
    print(f"{len(proved)} proved: {dict(Counter(truths.values()))}")
    print(*(f"proved/{name}: {truth}" for name, truth in truths.items() if truth != "true"), sep="\n")


def run(part: str = "lies", amount: str = "300") -> None:
    """Run a part of the benchmark."""
    folder = Path(tempfile.mkdtemp(prefix="proof-lies-"))
    print(f"files of faults are kept in {folder}")
    {"lies": lies, "fuzz": fuzz, "libfuzzer": libfuzzer}[part](int(amount), folder)

"""Result of a global search: upper bound on mu over all placements, and the best grasp found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.common.files import parse_json, read_text
from nlpgrasp.common.formatting import format_headroom, format_lower, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.quality_record import SCHEMA, bound_file_reference, is_small, write_bound

LARGEST = 512 * 2**20  # bytes, largest bound file


@dataclass(frozen=True)
class BestPossible:
    """Certified upper bound on mu over all placements of the contacts, and the best grasp found.

    Parameters
    ----------
    upper : float
        Upper bound on mu of every placement, valid however early the search was stopped.
    grasp : Grasp or None
        Best grasp found for the problem without its dropped parts; ``None`` if none exerts the task.
    mu : Bounds
        Certified quality of the grasp; 0 to 0 without one.
    faces : tuple of str
        Faces of its contacts.
    closed : bool
        Whether the requested gap was reached.
    nodes : int
        Number of nodes of the tree.
    seconds : float
        Wall time.
    dropped : tuple of str
        Names of the parts that the bound does not cover, such as a hand or constraints between contacts. They only
        lower mu: the bound holds for the problem with them as well, but the grasp may violate them.
    certificate : dict
        Data from which the bound can be recomputed (docs/how_close.md).
    problem : dict
        The problem, as JSON data.
    """

    upper: float
    grasp: Grasp | None
    mu: Bounds
    faces: tuple[str, ...]
    closed: bool
    nodes: int
    seconds: float
    dropped: tuple[str, ...] = ()
    certificate: Json = field(default_factory=dict, repr=False, compare=False)
    problem: Json = field(default_factory=dict, repr=False, compare=False)

    @property
    def gap(self) -> float:
        """Relative optimality gap ``upper / mu.lower - 1``, infinite without a grasp."""
        if self.mu.lower > 0.0:
            return self.upper / self.mu.lower - 1.0
        return 0.0 if self.upper == 0.0 else float("inf")

    def save(self, path: str | Path) -> Path:
        """Write bound and certificate as JSON for ``ng.verify``, atomically, and return the path.

        Raises
        ------
        InputError
            When the folder does not exist or cannot be written.
        """
        return write_bound(self.to_dict(), path)

    @classmethod
    def load(cls, path: str | Path) -> BestPossible:
        """Return a bound saved by ``save``.

        Raises
        ------
        InputError
            When the file cannot be read or holds no bound.
        """
        text = read_text(path, "a bound file", LARGEST)
        try:
            data = parse_json(text)
        except ValueError as error:
            raise InputError(str(path), f"no JSON: {error}", "a bound file") from None
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            schema = data.get("schema") if isinstance(data, Mapping) else type(data).__name__
            raise InputError(f"{path}: schema", schema, f'"{SCHEMA}"')
        try:
            return cls.from_dict(data)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(str(path), f"{type(error).__name__}: {error}", "what docs/how_close.md says") from None

    def to_dict(self) -> Json:
        """Return the bound as JSON data, an infinite gap as null."""
        grasp = None
        if self.grasp is not None:
            points, normals = self.grasp.points.tolist(), self.grasp.normals.tolist()
            grasp = {"positions": points, "normals": normals, "faces": list(self.faces), "mu": self.mu.to_dict()}
        return {
            "schema": SCHEMA,
            "upper": self.upper,
            "gap": self.gap if self.gap < float("inf") else None,
            "closed": self.closed,
            "nodes": self.nodes,
            "seconds": self.seconds,
            "dropped": list(self.dropped),
            "problem": self.problem,
            "grasp": grasp,
            "certificate": self.certificate,
        }

    @classmethod
    def from_dict(cls, data: Json) -> BestPossible:
        """Return a bound from the data of ``to_dict``."""
        grasp, mu, faces = None, Bounds(0.0, 0.0), ()
        candidate, certificate, problem = data["grasp"], data["certificate"], data["problem"]
        if candidate is not None:
            models = [contact_from_dict(contact) for contact in problem["contacts"]]
            grasp = Grasp(candidate["positions"], candidate["normals"], models, certificate["origin"])
            mu, faces = Bounds.from_dict(candidate["mu"], "grasp.mu"), tuple(candidate["faces"])
        return cls(
            float(data["upper"]),
            grasp,
            mu,
            faces,
            bool(data["closed"]),
            int(data["nodes"]),
            float(data["seconds"]),
            tuple(data["dropped"]),
            certificate,
            problem,
        )

    @property
    def is_small(self) -> bool:
        """Whether the certificate is small enough to be embedded in another file."""
        return is_small(self.certificate)

    def kept(self, file: str | Path | None = None) -> Json:
        """Return what another file embeds: the certificate, or name and digest of the saved bound's file.

        Parameters
        ----------
        file : str or Path, optional
            File of the saved bound, in the folder of the other file.

        Raises
        ------
        InputError
            When no file is named and the certificate is larger than 200 kB, or the file cannot be read.
        """
        if file is not None:
            return bound_file_reference(file)
        if not self.is_small:
            raise InputError("file", None, "the name of the saved bound, for a certificate of more than 200 kB")
        return self.certificate

    def __str__(self) -> str:
        without = f", without {', '.join(self.dropped)}" if self.dropped else ""
        bound = f"mu at most {format_upper(self.upper, 4)} over all placements{without}"
        if self.grasp is None:
            return f"{bound}; no grasp met ({self.nodes} nodes)"
        incumbent = f"best met {format_lower(self.mu.lower, 4)}; {format_headroom(self.gap, 2)}"
        return f"{bound}; {incumbent} ({self.nodes} nodes)"

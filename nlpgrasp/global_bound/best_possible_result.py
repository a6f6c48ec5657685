"""Result of a global search: a bound on mu over all placements, and the best grasp found."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.common.files import read_text
from nlpgrasp.common.formatting import at_least, at_most, headroom_words
from nlpgrasp.common.types import Json
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.quality_record import SCHEMA, is_small, reference, write_bound

LARGEST = 512 * 2**20  # bytes, largest file


@dataclass(frozen=True)
class BestPossible:
    """A bound on mu over all placements of the contacts, and the best grasp met on the way.

    Parameters
    ----------
    upper : float
        No placement has a larger mu. A proof: it holds however early the search was stopped.
    grasp : Grasp or None
        The best grasp met, of the problem without what was left out; ``None`` where none exerts the task.
    mu : Bounds
        Its certified quality; 0 to 0 where there is no grasp.
    faces : tuple of str
        The faces that its contacts are on.
    closed : bool
        Whether the gap is as small as was asked for.
    nodes : int
        Of the tree that was searched.
    seconds : float
        Wall time.
    dropped : tuple of str
        Parts of the problem that were left out because the bound does not cover them, such as a hand or constraints
        between contacts. They only lower mu: the bound holds for the problem with them as well, the grasp may not.
    certificate : dict
        What it takes to compute the bound again (docs/how_close.md).
    problem : dict
        What was asked, as JSON data.
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
        """``upper / mu.lower - 1``: by how much of its own quality the grasp misses the bound; inf without a grasp."""
        if self.mu.lower > 0.0:
            return self.upper / self.mu.lower - 1.0
        return 0.0 if self.upper == 0.0 else float("inf")

    def save(self, path: str | Path) -> Path:
        """Write bound and certificate as JSON, whole or not at all, and return the path; ``ng.verify`` checks the file.

        Raises
        ------
        InputError
            When the folder does not exist or cannot be written.
        """
        return write_bound(self.to_dict(), path)

    @classmethod
    def load(cls, path: str | Path) -> BestPossible:
        """Return the bound that ``save`` wrote.

        Raises
        ------
        InputError
            When the file cannot be read or holds no bound.
        """
        text = read_text(path, "a bound file", LARGEST)
        try:
            data = json.loads(text)
        except ValueError as error:
            raise InputError(str(path), f"no JSON: {error}", "a bound file") from None
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            found = data.get("schema") if isinstance(data, Mapping) else type(data).__name__
            raise InputError(f"{path}: schema", found, f'"{SCHEMA}"')
        try:
            return cls.from_dict(data)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(str(path), f"{type(error).__name__}: {error}", "what docs/how_close.md says") from None

    def to_dict(self) -> Json:
        """Return the bound as JSON data; a gap that is infinite as null."""
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
        """Return the bound that ``to_dict`` wrote."""
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
        """Whether another file may hold the certificate itself."""
        return is_small(self.certificate)

    def kept(self, file: str | Path | None = None) -> Json:
        """Return the certificate as other files hold it: itself, or the name and digest of the saved bound.

        Parameters
        ----------
        file : str or Path, optional
            Where the bound was saved, in the folder of the other file.

        Raises
        ------
        InputError
            When no file is named and the certificate is larger than 200 kB, or the file cannot be read.
        """
        if file is not None:
            return reference(file)
        if not self.is_small:
            raise InputError("file", None, "the name of the saved bound, for a certificate of more than 200 kB")
        return self.certificate

    def __str__(self) -> str:
        without = f", without {', '.join(self.dropped)}" if self.dropped else ""
        told = f"mu at most {at_most(self.upper, 4)} over all placements{without}"
        if self.grasp is None:
            return f"{told}; no grasp met ({self.nodes} nodes)"
        found = f"best met {at_least(self.mu.lower, 4)}; {headroom_words(self.gap, 2)}"
        return f"{told}; {found} ({self.nodes} nodes)"

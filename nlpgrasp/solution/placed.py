"""The grasp on its body, as a solution file states it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from nlpgrasp.common.shown.kept_normals import kept_normals
from nlpgrasp.common.shown.numbers import vector
from nlpgrasp.common.validation import FloatArray, within
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.schema.types import ContactData, GraspData

OWN_NORMAL = 1e-5  # radians: a stated normal so near the mesh's is the mesh's
FAR = 1e-3  # metres: a contact that moved farther is worth a word
MISLED = 0.01  # of the contacts' spread: a smooth surface that is farther off the mesh may lead to worse grasps


@dataclass(frozen=True)
class SurfaceMatch:
    """How far the solver's smooth surface is from the mesh at each contact.

    Parameters
    ----------
    distances : (k,) array
        From the solver's contact to the nearest point of the mesh, metres.
    angles : (k,) array
        Between the solver's normal and the mesh's at the final contact, radians.
    moved : (k,) array
        From the solver's contact to the final contact, metres: more than the distance where a contact slid
        over the mesh to a better triangle.
    stated : (k,) array or None
        Between the normals stated and the mesh's at the final contacts, radians: 0 unless fingertips that are not round
        keep the normals of the smooth surface. None for files of earlier versions, which do not state it.
    """

    distances: FloatArray
    angles: FloatArray
    moved: FloatArray
    stated: FloatArray | None = None

    @property
    def along(self) -> FloatArray:
        """About how far each contact slid along the mesh, (k,), metres: its way less the distance, as legs are."""
        return np.sqrt(np.maximum(self.moved**2 - self.distances**2, 0.0))

    def lines(self, size: float) -> list[str]:
        """Return in words how far contacts and normals on the smooth surface and on the mesh differ.

        Parameters
        ----------
        size : float
            Of the grasp, metres: how far apart its contacts are. What is less than a millimetre and a hundredth of it
            is not worth a word.
        """
        off, slid = (float(np.max(part, initial=0.0)) for part in (self.distances, self.along))
        lines = []
        if off > min(FAR, MISLED * size):
            better = "a finer or less smoothed surface (Mesh: resolution, smoothing) may lead to a better grasp"
            says = f"{self._of_the_mesh}, but {better}" if off > MISLED * size else "small for this grasp"
            told = f"the solver's smooth surface is up to {1e3 * off:.3g} mm off the mesh at {_which(self.distances)}"
            lines.append(f"  {told}: {says}")
        if slid > FAR:
            told = f"contacts slid up to {1e3 * slid:.3g} mm along the mesh in the last step ({_which(self.along)})"
            lines.append(f"  {told}: this is normal, positions and quality are those after it")
        if self.kept:
            lines.append(f"  {kept_normals(self.kept)}; the quality is that of the stated normals")
        return lines

    @property
    def kept(self) -> dict[int, float]:
        """Angles off the mesh's normals, radians, of the contacts whose stated normal is not the mesh's."""
        stated = np.zeros(0) if self.stated is None else self.stated
        return {i: float(stated[i]) for i in np.flatnonzero(stated > OWN_NORMAL).tolist()}

    @property
    def _of_the_mesh(self) -> str:
        if self.stated is None or self.kept:
            return "the positions stated are of the mesh"
        return "the positions and normals stated are of the mesh"

    def at(self, i: int) -> dict[str, float]:
        """Return what contact ``i``'s entry says of it."""
        return {
            "surface_distance": float(self.distances[i]),
            "surface_angle": float(self.angles[i]),
            **({} if self.stated is None else {"normal_angle": float(self.stated[i])}),
            "moved": float(self.moved[i]),
        }

    @classmethod
    def of(cls, contacts: list[ContactData]) -> SurfaceMatch | None:
        """Return what the contacts' entries say, None where one of them says nothing."""
        if not all("surface_distance" in c and "surface_angle" in c and "moved" in c for c in contacts):
            return None
        return cls(
            np.array([c["surface_distance"] for c in contacts], float),
            np.array([c["surface_angle"] for c in contacts], float),
            np.array([c["moved"] for c in contacts], float),
            np.array([c["normal_angle"] for c in contacts], float)
            if all("normal_angle" in c for c in contacts)
            else None,
        )


@dataclass(frozen=True)
class PlacedGrasp:
    """A grasp, and where on the body it is.

    Parameters
    ----------
    grasp : Grasp
    faces : tuple of k str
        The face each contact is on.
    surface : SurfaceMatch or None
        For meshes.
    """

    grasp: Grasp
    faces: tuple[str, ...]
    surface: SurfaceMatch | None = None

    def lines(self, fingers: Sequence[str] = ()) -> list[str]:
        """Return the contacts in words, one a line; with the fingers' links where they have some."""
        result = []
        for i, (p, n, face) in enumerate(zip(self.grasp.points, self.grasp.normals, self.faces, strict=True)):
            which = f"{i} ({fingers[i]})" if fingers else f"{i}"
            result.append(f"  contact {which} on {face}: position [{vector(p, 4)}] m, inward normal [{vector(n, 4)}]")
        size = float(np.linalg.norm(np.ptp(self.grasp.points, axis=0)))
        return result if self.surface is None else [*result, *self.surface.lines(size)]

    def to_dict(self) -> GraspData:
        """Return the grasp as JSON data, contact by contact."""
        return {
            "dimension": self.grasp.dimension,
            "torque_origin": self.grasp.torque_origin.tolist(),
            "contacts": [self._contact(i) for i in range(len(self.grasp))],
        }

    def _contact(self, i: int) -> ContactData:
        grasp = self.grasp
        entries = {
            "position": grasp.points[i].tolist(),
            "normal": grasp.normals[i].tolist(),
            "tangents": grasp.tangents[i].tolist(),
            "face": self.faces[i],
            **grasp.contacts[i].to_dict(),
            **({} if self.surface is None else self.surface.at(i)),
        }
        return cast(ContactData, entries)  # and those of its contact model

    @classmethod
    def from_dict(cls, data: GraspData, name: str) -> PlacedGrasp:
        """Return the grasp that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When the numbers make no grasp, or one of another dimension; ``name`` is shown in the message.
        """
        contacts = data["contacts"]
        with within(f"{name}."):
            grasp = Grasp(
                [c["position"] for c in contacts],
                [c["normal"] for c in contacts],
                [contact_from_dict(c) for c in contacts],
                data["torque_origin"],
                [c["tangents"] for c in contacts],
            )
        if grasp.dimension != data["dimension"]:
            raise InputError(f"{name}.dimension", data["dimension"], f"{grasp.dimension}, as the positions say")
        return cls(grasp, tuple(str(c.get("face", "")) for c in contacts), SurfaceMatch.of(contacts))


def _which(values: FloatArray) -> str:
    """Return the contact with the largest of values (k,), in words."""
    return f"contact {int(np.argmax(values))}"

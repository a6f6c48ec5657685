"""Grasp on its body: contacts, their faces, and deviations between smoothed surface and mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.formatting import vector
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, prefix_errors
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp

OWN_NORMAL = 1e-5  # radians: a stated normal this near the mesh's counts as the mesh's
FAR = 1e-3  # metres: larger moves of contacts are reported
MISLED = 0.01  # share of the contacts' spread: larger distances of smooth surface and mesh are warned of


@dataclass(frozen=True)
class PlacedGrasp:
    """Grasp with the face of each contact, and deviations between smoothed surface and mesh.

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
        """Return text lines about the contacts, one for each, with the fingers' links if any."""
        result = []
        for i, (p, n, face) in enumerate(zip(self.grasp.points, self.grasp.normals, self.faces, strict=True)):
            label = f"{i} ({fingers[i]})" if fingers else f"{i}"
            result.append(f"  contact {label} on {face}: position [{vector(p, 4)}] m, inward normal [{vector(n, 4)}]")
        size = float(np.linalg.norm(np.ptp(self.grasp.points, axis=0)))
        return result if self.surface is None else [*result, *self.surface.lines(size)]

    def to_dict(self) -> Json:
        """Return the grasp as JSON data, contact by contact."""
        return {
            "dimension": self.grasp.dimension,
            "torque_origin": self.grasp.torque_origin.tolist(),
            "contacts": [self._contact(i) for i in range(len(self.grasp))],
        }

    def _contact(self, i: int) -> Json:
        grasp = self.grasp
        return {
            "position": grasp.points[i].tolist(),
            "normal": grasp.normals[i].tolist(),
            "tangents": grasp.tangents[i].tolist(),
            "face": self.faces[i],
            **grasp.contacts[i].to_dict(),
            **({} if self.surface is None else self.surface.at(i)),
        }

    @classmethod
    def from_dict(cls, data: Json, name: str) -> PlacedGrasp:
        """Return the grasp that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When the numbers make no grasp, or one of another dimension; ``name`` is shown in the message.
        """
        contacts = data["contacts"]
        with prefix_errors(f"{name}."):
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


@dataclass(frozen=True)
class SurfaceMatch:
    """Deviations of the solver's smoothed surface from the mesh at each contact.

    Parameters
    ----------
    distances : (k,) array
        Distance of the solver's contact from the nearest point of the mesh, metres.
    angles : (k,) array
        Angle between the solver's normal and the mesh's at the final contact, radians.
    moved : (k,) array
        Distance of the solver's contact from the final contact, metres: more than ``distances`` where a contact slid
        over the mesh to a better triangle.
    stated : (k,) array or None
        Angle between the stated normals and the mesh's at the final contacts, radians: 0 unless fingertips that are not
        round keep the normals of the smooth surface. None for files of earlier versions.
    """

    distances: FloatArray
    angles: FloatArray
    moved: FloatArray
    stated: FloatArray | None = None

    @property
    def along(self) -> FloatArray:
        """Approximate distance that each contact slid along the mesh, (k,), metres."""
        return np.sqrt(np.maximum(self.moved**2 - self.distances**2, 0.0))

    def lines(self, size: float) -> list[str]:
        """Return text lines about the deviations of contacts and normals between smoothed surface and mesh.

        Parameters
        ----------
        size : float
            Spread of the contacts, metres. Differences below a millimetre and a hundredth of it are not reported.
        """
        distance, sliding = (float(np.max(values, initial=0.0)) for values in (self.distances, self.along))
        lines = []
        if distance > min(FAR, MISLED * size):
            remedy = "a finer or less smoothed surface (Mesh: resolution, smoothing) may lead to a better grasp"
            assessment = f"{self._of_the_mesh}, but {remedy}" if distance > MISLED * size else "small for this grasp"
            contact = _worst_contact(self.distances)
            observation = f"the solver's smooth surface is up to {1e3 * distance:.3g} mm off the mesh at {contact}"
            lines.append(f"  {observation}: {assessment}")
        if sliding > FAR:
            contact = _worst_contact(self.along)
            observation = f"contacts slid up to {1e3 * sliding:.3g} mm along the mesh in the last step ({contact})"
            lines.append(f"  {observation}: this is normal, positions and quality are those after it")
        if self.kept:
            lines.append(f"  {deviating_normals_message(self.kept)}; the quality is that of the stated normals")
        return lines

    @property
    def kept(self) -> dict[int, float]:
        """Angle between stored normal and mesh normal, radians, by contact, where they differ."""
        angles = np.zeros(0) if self.stated is None else self.stated
        return {i: float(angles[i]) for i in np.flatnonzero(angles > OWN_NORMAL).tolist()}

    @property
    def _of_the_mesh(self) -> str:
        if self.stated is None or self.kept:
            return "the positions stated are of the mesh"
        return "the positions and normals stated are of the mesh"

    def at(self, i: int) -> dict[str, float]:
        """Return the deviations at contact ``i`` as JSON data."""
        return {
            "surface_distance": float(self.distances[i]),
            "surface_angle": float(self.angles[i]),
            **({} if self.stated is None else {"normal_angle": float(self.stated[i])}),
            "moved": float(self.moved[i]),
        }

    @classmethod
    def of(cls, contacts: Sequence[Json]) -> SurfaceMatch | None:
        """Return the deviations in the contacts' JSON entries; None if any entry lacks them."""
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


def _worst_contact(values: FloatArray) -> str:
    """Return the name of the contact with the largest of the values (k,)."""
    return f"contact {int(np.argmax(values))}"


def deviating_normals_message(angles: Mapping[int, float]) -> str:
    """Return the message about contacts whose normals are not the mesh's, with the angles in degrees.

    Parameters
    ----------
    angles : mapping
        Angle by contact, radians; at least one.
    """
    degrees = [f"{np.degrees(angle):.2g}" for angle in angles.values()]
    contacts = [str(i) for i in angles]
    if len(degrees) == 1:
        return f"the normal stated at contact {contacts[0]} is not the mesh's: it is {degrees[0]} degrees off"
    listed = f"{', '.join(contacts[:-1])} and {contacts[-1]}"
    angles_text = f"{', '.join(degrees[:-1])} and {degrees[-1]}"
    return f"the normals stated at contacts {listed} are not the mesh's: they are {angles_text} degrees off"

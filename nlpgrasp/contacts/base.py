"""What every contact model states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.validation import FloatArray, names


@dataclass(frozen=True)
class ContactModel(ABC):
    """A contact model: its force components and its force domain K_i, a closed convex cone (Section 2.4).

    Force components are written in the contact frame, normal first: ``(f_n, f_t1, f_t2, torsion)``, of which
    a model has the first few. Methods marked *symbolic* use arithmetic only, so that they serve CasADi
    expressions and numpy arrays alike.

    Parameters
    ----------
    faces : str or sequence of str, optional
        Names of the body's faces this contact may use; ``None`` means all.
    """

    kind: ClassVar[str]
    faces: str | Iterable[str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", names(f"{type(self).__name__}.faces", self.faces))

    @abstractmethod
    def components(self, space: int) -> int:
        """Return n_i, the number of independent force components in the plane (2) or in space (3)."""

    def basis(self, space: int) -> FloatArray:
        """Return ``B_i`` of (2.3-5): which contact-frame wrenches this model can exert.

        Returns
        -------
        (3, n_i) array in the plane, (6, n_i) in space
            Contact-frame wrenches are ``(f_n, f_t, m)`` and ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)``.
        """
        return np.eye(3 if space == 2 else 6)[:, : self.components(space)]

    @abstractmethod
    def project(self, z: FloatArray) -> FloatArray:
        """Return the Euclidean projection of force components ``z`` (..., n_i) onto K_i."""

    @abstractmethod
    def split(self, x: Any, normal: Any) -> tuple[Any, Any]:
        """Return the force (body frame) and the torsion moment of NLP variables ``x`` (symbolic).

        The second value is the scalar moment about the normal, or ``None``.
        """

    @abstractmethod
    def membership(self, x: Any, normal: Any) -> list[tuple[str, Any]]:
        """Return named expressions that are all non-negative exactly when ``x`` is in K_i (symbolic)."""

    @abstractmethod
    def squared_support(self, normal: Any, tangential: Any, torsion: Any, ops: Any) -> Any | None:
        """Return ``||P_K(z)||^2`` in closed form (symbolic), or ``None`` when there is none.

        Parameters
        ----------
        normal, tangential, torsion : expression
            ``z_n``, ``|z_t| >= 0`` and ``|z_torsion| >= 0``.
        ops : module
            ``numpy`` or ``casadi``: supplies ``fmax`` and ``fmin``.
        """

    @abstractmethod
    def variables(self, space: int) -> int:
        """Return how many NLP variables carry this contact's force."""

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variables of a unit force along the inward normal ``(space,)``."""
        size = self.variables(normal.shape[0])
        return np.concatenate([normal, np.zeros(max(0, size - normal.shape[0]))])[:size]

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the model as JSON data: ``model`` and its coefficients."""

"""Base classes of bodies and their smooth faces."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import casadi as ca
import numpy as np
from scipy.ndimage import gaussian_filter

from nlpgrasp.bodies.chart import Chart
from nlpgrasp.common.display import InNotebook, show
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.registry import JsonPart
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray, format_known_names
from nlpgrasp.errors import InputError

# functions that write the HTML page and the notebook's card
PAGE, CARD = ("nlpgrasp.report.body_page", "write_body"), ("nlpgrasp.report.body_page", "body_card")
TINY = 1e-24  # m^2 under a square root, which makes it differentiable at zero
ON_FACE = 1e-6  # of the body's size: distance within which a point counts as on a face


@dataclass(frozen=True, repr=False)
class Face:
    """A smooth piece of a body's surface: ``h(p) = 0`` within given limits.

    Parameters
    ----------
    name : str
    surface : callable
        ``surface(p) -> h``: zero on the face, negative inside the body, positive outside; p is a CasADi
        column of 2 or 3 metres.
    extent : callable
        ``extent(p) -> list`` of expressions that are at most zero on the face: there, minus the distances from its
        edges, metres.
    sharp : sequence of bool, optional
        For each expression of ``extent``, whether that edge is sharp (the normal turns by more than 30 degrees); by
        default all are.
    edges : callable
        ``edges(p) -> list`` of expressions: distances of a point from further sharp edges, metres.
    room : float
        The largest distance from sharp edges on the face, metres.
    """

    name: str
    surface: Callable[[Expression], Expression]
    extent: Callable[[Expression], Sequence[Expression]] = lambda p: ()
    sharp: Sequence[bool] | None = None
    edges: Callable[[Expression], Sequence[Expression]] = lambda p: ()
    room: float = np.inf

    def __repr__(self) -> str:
        return f"Face({self.name!r})"

    def limits(self, p: Expression, margin: float) -> list[Expression]:
        """Return expressions that are at most 0 inside the face, at least a margin (metres) off its sharp edges."""
        without_margin = list(self.extent(p))
        sharp = [True] * len(without_margin) if self.sharp is None else list(self.sharp)
        limits = [limit + margin * s for limit, s in zip(without_margin, sharp, strict=True)]
        return limits + [margin - distance for distance in self.edges(p)] if margin > 0.0 else limits

    def compile_surface(self, p: Expression, margin: float) -> ca.Function:
        """Return a compiled CasADi function: point to (h, gradient norm, unit outward normal, limits)."""
        h = self.surface(p)
        gradient = ca.gradient(h, p)
        slope = ca.norm_2(gradient)
        limits = self.limits(p, margin)
        outputs = [h, slope, gradient / slope, ca.vertcat(*limits) if limits else ca.DM.zeros(0, 1)]
        name = "surface_" + "".join(c if c.isalnum() else "_" for c in self.name).strip("_")
        while "__" in name:
            name = name.replace("__", "_")
        return ca.Function(name, [p], outputs, ["p"], ["h", "slope", "normal", "limits"])


def exterior_angles(corners: FloatArray) -> FloatArray:
    """Return the exterior angle at each vertex (m, 2) of a polygon, (m,), radians, positive for a left turn."""
    incoming, outgoing = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    cross = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
    return np.asarray(np.arctan2(cross, np.sum(incoming * outgoing, axis=1)))


class DisplayedBody(InNotebook, JsonPart):
    """Mixin that shows a body on an HTML page and in notebooks."""

    _card: ClassVar[tuple[str, str]] = CARD

    @property
    def shown_name(self) -> str:
        """Title of the HTML page that shows the body."""
        return self.kind

    def show(self, path: str | Path | None = None) -> Path:
        """Write an HTML page that shows the body, open it in a browser if possible, and return its path.

        It shows the surface, the axes of its frame, the names of its faces, its size and bounds. It opens from disk and
        needs no network. Without a browser or a display, the path is printed.

        Parameters
        ----------
        path : str or Path, optional
            Of the HTML page; by default a temporary file.

        Raises
        ------
        InputError
            For a path that cannot be written.
        """
        return show(self, self.shown_name, PAGE, path)


class Body(DisplayedBody):
    """A rigid body bounded by smooth faces ``h(p) = 0``, metres, in the body frame.

    Each surface is stated once, as a CasADi expression; numerical values come from its compiled function.

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    tight : bool
        Whether the body touches all sides of ``bounds``; else they are only a box around it.
    """

    tight: ClassVar[bool] = True

    @property
    def space(self) -> int:
        """Dimension of the space: 3, or 2 for a planar body."""
        return 3

    @property
    @abstractmethod
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space): lower corner, upper corner, metres."""

    @property
    @abstractmethod
    def centroid(self) -> FloatArray:
        """Centre of volume (of area for planar bodies), (space,), metres."""

    @abstractmethod
    def make_faces(self) -> tuple[Face, ...]:
        """Return the faces that bound the body; called once."""

    @cached_property
    def faces(self) -> tuple[Face, ...]:
        """Faces that bound the body."""
        return self.make_faces()

    @property
    def face_names(self) -> tuple[str, ...]:
        """Names of the body's faces, in order."""
        return tuple(face.name for face in self.faces)

    def face(self, name: str) -> Face:
        """Return the face with the given name; raise ``InputError`` if the body has no such face."""
        for face in self.faces:
            if face.name == name:
                return face
        raise InputError(f"{type(self).__name__}.face", name, ", ".join(self.face_names))

    @property
    def size(self) -> float:
        """Characteristic length: half the bounding box's diagonal, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]) / 2.0)

    @property
    def cramped(self) -> bool:
        """Whether a fingertip in contact at one point of the body may penetrate it at another: false if convex."""
        return False

    @property
    def symbol(self) -> type[ca.SX] | type[ca.MX]:
        """CasADi type of the surface expressions: ``casadi.SX``, or ``casadi.MX`` for splines."""
        return ca.SX

    def point(self) -> Expression:
        """Return a CasADi symbol for a point in the body frame, (space,), of the type ``symbol``."""
        return self.symbol.sym("p", self.space)

    def distance(self, p: Expression) -> Expression:
        """Return the signed distance of a CasADi point, metres, negative inside; outside possibly a lower bound.

        A lower bound makes constraints on clearance conservative. By default ``h / |grad h|``, exact to first order
        near the surface and a lower bound wherever h is convex; a body with several faces has to define it.
        """
        if len(self.faces) > 1:
            raise NotImplementedError(f"{type(self).__name__}.distance")
        h = self.faces[0].surface(p)
        return h / ca.sqrt(ca.sumsqr(ca.gradient(h, p)) + TINY)

    def triangles(self) -> tuple[FloatArray, IntArray] | None:
        """Return a triangulation of the surface: vertices (n, 3), metres, and triangles (m, 3); by default None.

        The vertices are on the surface. Triangles are counter-clockwise from outside. A planar body is a plate about z
        = 0, ``PLATE`` of its size thick.
        """
        return None

    def charts(self) -> tuple[Chart, ...]:
        """Return charts that together cover all faces, for bounds over all placements; by default none are stated."""
        return ()

    @cached_property
    def distance_function(self) -> ca.Function:
        """Compiled ``distance``: a ``casadi.Function`` of a point (space,), in metres."""
        p = self.point()
        return ca.Function("distance", [p], [self.distance(p)], ["p"], ["d"])

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, space) to the body, (m,), metres, negative inside."""
        return self.distances(np.asarray(points))[0][:, 0]

    def distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray:
        """Return ``distance`` at the points of a tensor grid with the given coordinates, (nx, ny, nz), metres."""
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return np.asarray(Body.signed_distance(self, grid.reshape(-1, len(axes)))).reshape(grid.shape[:-1])

    def smooth_distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray:
        """Return a distance from the surface of contacts, without edges, on such a grid, (nx, ny, nz), metres."""
        return np.asarray(gaussian_filter(self.distance_on_grid(axes), 1.0))

    def edge_distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray | None:
        """Return the distance from sharp edges on such a grid, (nx, ny, nz), metres; by default None: not known."""
        del axes
        return None

    @cached_property
    def distances(self) -> BatchEvaluator:
        """Evaluator of ``distance_function`` at many points (m, space)."""
        return BatchEvaluator(self.distance_function)

    def select(self, names: Iterable[str] | None, field: str) -> tuple[str, ...]:
        """Return the given face names, or all of the body's if None; raise for unknown names."""
        if names is None:
            return self.face_names
        selected = tuple(names)
        unknown = [n for n in selected if n not in self.face_names]
        if unknown:
            raise InputError(
                field, ", ".join(unknown), f"faces of the body: {format_known_names(unknown, self.face_names)}"
            )
        return selected

    def surface_function(self, name: str, margin: float = 0.0) -> ca.Function:
        """Return the compiled function ``p -> (h, gradient norm, unit outward normal, limits)`` of a face.

        The limits are at most zero at points of the face at least a margin, metres, away from its sharp edges.
        """
        functions = self._functions
        if (name, margin) not in functions:
            functions[name, margin] = self.face(name).compile_surface(self.point(), margin)
        return functions[name, margin]

    def _surface_evaluator(self, name: str, margin: float = 0.0) -> BatchEvaluator:
        """Return an evaluator of ``surface_function`` at many points."""
        evaluators = self._surface_evaluators
        if (name, margin) not in evaluators:
            evaluators[name, margin] = BatchEvaluator(self.surface_function(name, margin))
        return evaluators[name, margin]

    def shared_surface(self, margin: float) -> ca.Function | None:
        """Return the function ``(p, geometry) -> (h, unit outward normal, limits)`` shared by all faces, or None."""
        return None

    def geometry(self, name: str) -> FloatArray:
        """Return the parameters of a face, (q,), that ``shared_surface`` takes as ``geometry``."""
        raise NotImplementedError(f"{type(self).__name__}.geometry")

    def room(self, name: str) -> float:
        """Return the largest distance of a point of the face from sharp edges, metres; inf without sharp edges."""
        return self.face(name).room

    def edge_distance(self, name: str, points: FloatArray) -> FloatArray:
        """Return the distances (m,), metres, of points (m, space) of a face from sharp edges; inf without any."""
        face = self.face(name)
        if not np.isfinite(face.room):
            return np.full(len(points), np.inf)
        sharp = slice(None) if face.sharp is None else np.asarray(face.sharp, dtype=bool)
        return np.asarray(-np.max(self._surface_evaluator(name)(points)[3][:, sharp], axis=1))

    def evaluate(
        self, name: str, points: FloatArray, margin: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return h, gradient norm, unit outward normal and largest limit of a face at points (m, space).

        Parameters
        ----------
        name : str
            Of the face.
        points : (m, space) array
        margin : float
            From sharp edges, metres: as in ``surface_function``.

        Returns
        -------
        h : (m,) array
            Zero on the face, negative inside the body.
        slope : (m,) array
            Size of the gradient: ``h / slope`` is the distance to the surface to first order.
        normals : (m, space) array
            Unit, outward.
        limit : (m,) array
            Largest of the face's limits, at most zero on the face; ``-inf`` for a face without limits.
        """
        h, slope, normals, limits = self._surface_evaluator(name, margin)(points)
        return h[:, 0], slope[:, 0], normals, np.max(limits, axis=1, initial=-np.inf)

    def is_on(self, name: str, points: FloatArray, margin: float = 0.0) -> BoolArray:
        """Return whether points (m, space) are on a face and at least a margin, metres, from its sharp edges, (m,)."""
        h, slope, _, limit = self.evaluate(name, points, margin)
        return (np.abs(h) <= ON_FACE * self.size * slope) & (limit <= ON_FACE * self.size)

    def snap(self, name: str, points: FloatArray, iterations: int = 12) -> FloatArray:
        """Return points (m, space) projected onto a face's surface ``h = 0`` by Newton steps along the normal."""
        lower, upper = self.bounds
        margin = 0.05 * self.size
        p = np.array(points, dtype=float)
        for _ in range(iterations):
            h, slope, normal, _ = self.evaluate(name, p)
            step = h / np.maximum(slope, 1e-12)
            step = np.clip(step, -0.5 * self.size, 0.5 * self.size)
            p = np.clip(p - step[:, None] * normal, lower - margin, upper + margin)
            if np.max(np.abs(step), initial=0.0) < 1e-14 * self.size:
                break
        return p

    def sample(self, name: str, count: int, rng: np.random.Generator, margin: float = 0.0) -> FloatArray:
        """Return up to ``count`` random points of a face, roughly uniform, at least a margin from its sharp edges.

        Returns
        -------
        (m, space) array
            Fewer than ``count`` rows only if the face is hard to sample; none if it is empty.
        """
        lower, upper = self.bounds
        samples: list[FloatArray] = []
        total = 0
        for _ in range(8):
            p = self.snap(name, self._surrounding_points(count, rng))
            h, slope, _, limit = self.evaluate(name, p, margin)
            in_bounds = np.all((p >= lower - 1e-9 * self.size) & (p <= upper + 1e-9 * self.size), axis=1)
            is_valid = (
                (np.abs(h) <= 1e-9 * self.size * np.maximum(slope, 1e-12)) & (limit <= 1e-9 * self.size) & in_bounds
            )
            is_valid &= slope > 1e-9
            samples.append(p[is_valid])
            total += int(is_valid.sum())
            if total >= count:
                break
        return np.concatenate(samples)[:count]

    def _surrounding_points(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return random points (m, space), enough for about ``count`` samples of a face by projection."""
        lower, upper = self.bounds
        return rng.uniform(lower, upper, (4 * count + 16, self.space))

    @cached_property
    def _functions(self) -> dict[tuple[str, float], ca.Function]:
        return {}

    @cached_property
    def _surface_evaluators(self) -> dict[tuple[str, float], BatchEvaluator]:
        return {}

    def __getstate__(self) -> dict[str, object]:
        """Return the state without compiled functions, which are rebuilt after unpickling."""
        compiled = ("_functions", "_surface_evaluators", "distance_function", "distances")
        derived = ("faces", "centroid", "_tree", "_edges", "distance_grid", *compiled)
        return {k: v for k, v in self.__dict__.items() if k not in derived}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)


def intersection(parts: Sequence[Expression]) -> Expression:
    """Return the signed distance of a point to an intersection of sets, as a CasADi expression.

    ``parts`` are the signed distances of the point to each set. It is exact where their gradients are orthogonal.
    """
    squared_outside = sum(ca.fmax(d, 0.0) ** 2 for d in parts)
    largest = parts[0]
    for d in parts[1:]:
        largest = ca.fmax(largest, d)
    return ca.sqrt(squared_outside + TINY) + ca.fmin(largest, 0.0)


class CentredBody(Body):
    """A body in space whose bounding box and centroid are centred on the origin."""

    @property
    @abstractmethod
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, 3): lower corner, upper corner, metres."""
        return np.stack([-self.half_size, self.half_size])

    @property
    def centroid(self) -> FloatArray:
        """Centre of volume, (3,), metres: the origin, even if it is outside the body."""
        return np.zeros(3)

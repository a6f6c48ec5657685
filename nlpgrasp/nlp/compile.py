"""From a :class:`Program` to an IPOPT solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from nlpgrasp.nlp.distances import DistanceRows, chain_first, chain_second
from nlpgrasp.nlp.program import Program
from nlpgrasp.validation import FloatArray


@dataclass(frozen=True)
class NlpResult:
    """What the solver returned.

    Parameters
    ----------
    z : (n,) array
        Variables, solver units.
    multipliers : (m,) array
        Of the rows: positive where the upper limit is active, negative where the lower one is.
    objective : float
        The maximised value.
    status : str
        The solver's own word.
    success : bool
    iterations : int
    seconds, function_seconds : float
        Wall time of the solve, and of the function evaluations in it.
    face_rows : int
        How many of the rows, at the end, tie contacts to faces.
    """

    z: FloatArray
    multipliers: FloatArray
    objective: float
    status: str
    success: bool
    iterations: int
    seconds: float
    function_seconds: float
    face_rows: int = 0


class CompiledProgram:
    """A program with its solver: built once, solved from many starts with many parameters.

    Parameters
    ----------
    program : Program
    ipopt : dict
        Options of IPOPT, without the ``ipopt.`` prefix.
    """

    def __init__(self, program: Program, ipopt: dict[str, Any]) -> None:
        self.program = program
        options: dict[str, Any] = {f"ipopt.{key}": value for key, value in ipopt.items()}
        options |= {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "record_time": True}
        nlp, derivatives = _nlp(program)
        self._solver = ca.nlpsol("grasp", "ipopt", nlp, options | derivatives)

    def solve(
        self,
        start: FloatArray,
        parameters: FloatArray,
        bounds: tuple[FloatArray, FloatArray] | None = None,
    ) -> NlpResult:
        """Solve from a start.

        Parameters
        ----------
        start : (n,) array
        parameters : (q,) array
        bounds : pair of (n,) arrays, optional
            In place of the program's own bounds, for example a trust region inside them.
        """
        lower, upper = self.program.bounds if bounds is None else bounds
        low, high = self.program.limits
        found = self._solver(x0=start, p=parameters, lbx=lower, ubx=upper, lbg=low, ubg=high)
        stats = self._solver.stats()
        return NlpResult(
            z=np.asarray(found["x"].full()).ravel(),
            multipliers=np.asarray(found["lam_g"].full()).ravel(),
            objective=-float(found["f"]),
            status=str(stats["return_status"]),
            success=bool(stats["success"]),
            iterations=int(stats["iter_count"]),
            seconds=float(stats["t_wall_total"]),
            function_seconds=float(sum(v for key, v in stats.items() if key.startswith("t_wall_nlp_"))),
            face_rows=sum(part.linear.shape[0] for part in self.program.face_parts),
        )


def _nlp(program: Program) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the CasADi program and, where it is not all ``SX``, hand-assembled derivative functions."""
    if not program.distance_parts and all(part.function.is_a("SXFunction") for part in program.face_parts):
        z = program.z
        rows = [program.g] + [part.function(z[part.position.range]) + part.linear for part in program.face_parts]
        return {"x": z, "p": program.theta, "f": -program.objective, "g": ca.vertcat(*rows)}, {}
    return _mixed(program)


def _mixed(program: Program) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the program with faces and distances as ``MX`` and everything else as ``SX`` functions.

    CasADi would colour the Hessian of the whole graph and evaluate it through MX at 10 ms a call; the Lagrangian
    splits into an SX part with an exact sparse Hessian, one small block per contact, and the distances, whose
    second derivatives by the chain rule are SX again once the spline's own derivatives are numbers.
    """
    z, theta = program.z, program.theta
    linear = ca.vertcat(*[part.linear for part in program.face_parts])
    smooth, near, count = program.g.shape[0], program.distances, linear.shape[0]
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", smooth)
    rows = ca.Function("rows", [z, theta], [program.g, linear])
    lagrangian = -lam_f * program.objective + ca.dot(lam_g, program.g)
    objective = ca.Function("objective", [z, theta], [-program.objective])
    points = program.points
    slopes, bends = ca.SX.sym("slopes", points.shape[0]), ca.SX.sym("bends", 6 * near)
    along = ca.jacobian(points, z)
    first = [ca.jacobian(program.g, z), chain_first(along, slopes, near), ca.jacobian(linear, z)]
    jacobian = ca.Function("rows_jac", [z, theta, slopes], [ca.vertcat(*first)], {"cse": True})
    second = ca.hessian(lagrangian + ca.dot(slopes, points), z)[0] + chain_second(along, bends, near)
    inputs = [z, theta, lam_f, lam_g, slopes, bends]
    hessian = ca.Function("rows_hess", inputs, [ca.triu(second)], {"cse": True})
    places = ca.Function("points", [z], [points], {"cse": True})

    x, p = ca.MX.sym("x", z.shape[0]), ca.MX.sym("p", theta.shape[0])
    lam, sigma = ca.MX.sym("lam_g", smooth + near + count), ca.MX.sym("lam_f")
    smooth_rows, linear_rows = rows(x, p)
    distances = DistanceRows(program, places(x))
    values, gradients = distances.first()
    weighted, curvature = distances.second(lam[smooth : smooth + near])
    face_rows, jacobians, hessians, done = [], [], [], smooth + near
    for part in program.face_parts:
        q = ca.MX.sym("q", part.position.stop - part.position.start)
        face = part.function(q)
        weight = ca.MX.sym("w", face.shape[0])
        slope = ca.Function("face_jac", [q], [ca.jacobian(face, q)])
        bend = ca.Function("face_hess", [q, weight], [ca.triu(ca.hessian(ca.dot(weight, face), q)[0])])
        here = x[part.position.range]
        face_rows.append(part.function(here))
        jacobians.append(_embed(slope(here), face.shape[0], part.position, z.shape[0]))
        local = bend(here, lam[done : done + face.shape[0]])
        hessians.append(_embed_square(local, part.position, z.shape[0]))
        done += face.shape[0]
    g = ca.vertcat(smooth_rows, values, linear_rows + ca.vertcat(*face_rows))
    jac = jacobian(x, p, gradients) + ca.vertcat(ca.MX(smooth + near, z.shape[0]), *jacobians)
    hess = hessian(x, p, sigma, lam[:smooth], weighted, curvature)
    for block in hessians:
        hess = hess + block
    derivatives = {
        "jac_g": ca.Function("jac_g", [x, p], [g, jac], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [x, p, sigma, lam],
            [ca.triu(hess)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    return {"x": x, "p": p, "f": objective(x, p), "g": g}, derivatives


def _embed(block: Any, rows: int, columns: Any, width: int) -> Any:
    """Return ``block`` (rows, m) as columns of a sparse (rows, width) matrix."""
    return ca.horzcat(ca.MX(rows, columns.start), block, ca.MX(rows, width - columns.stop))


def _embed_square(block: Any, where: Any, width: int) -> Any:
    """Return ``block`` as a diagonal block of a sparse (width, width) matrix."""
    return ca.diagcat(ca.MX(where.start, where.start), block, ca.MX(width - where.stop, width - where.stop))

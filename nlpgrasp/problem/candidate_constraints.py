"""Scalar constraints of a grasp candidate from constraints and hand, in a fixed order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from nlpgrasp.bodies import Body
from nlpgrasp.common.scalar_constraints import (
    FINGERTIP_CLEARANCE,
    Clearance,
    ScalarConstraint,
    SymbolicCandidate,
)
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.value_digest import expression_digest, unique_digest
from nlpgrasp.constraints import Constraint, PlacementConstraint
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand

FITS = 0.99  # of a fingertip's radius: least distance of its centre from the body


@dataclass(frozen=True)
class CandidateConstraints:
    """Scalar constraints of a grasp candidate: expressions, and clearances through a mesh distance.

    Parameters
    ----------
    rows : tuple of ScalarConstraint
    clearances : tuple of Clearance
    sources : tuple of tuple of int
        Indices in ``named`` of the scalar constraints of each constraint, in order, then of the hand.
    """

    rows: tuple[ScalarConstraint, ...]
    clearances: tuple[Clearance, ...] = ()
    sources: tuple[tuple[int, ...], ...] = ()

    @property
    def named(self) -> tuple[ScalarConstraint, ...]:
        """All scalar constraints in the NLP's order; the expression of a clearance is None."""
        return (*self.rows, *(c.row(None) for c in self.clearances))


def hand_variable_name(variable: str) -> str:
    """Return the displayed name of a hand variable, such as ``"palm position"``."""
    return variable.replace("_", " ")


def symbolic_candidate(
    hand: Hand | None,
    positions: Sequence[Expression],
    normals: Sequence[Expression],
    variables: dict[str, Expression],
    size: float,
) -> SymbolicCandidate:
    """Return the symbolic grasp candidate of contacts and hand variables, as constraints take it."""
    if hand is None:
        return SymbolicCandidate(positions, normals, (0.0,) * len(positions), size, hand={})
    palm, closing = hand.palm(variables), hand.closing(positions)
    named_variables = {hand_variable_name(name): symbols for name, symbols in variables.items()}
    return SymbolicCandidate(positions, normals, hand.tip_radii, size, (), palm, closing, named_variables)


def expression_data(constraint: PlacementConstraint, body: Body, hand: Hand | None, contacts: int) -> Json:
    """Return the digest of a user's constraint as JSON data; empty for other constraints, which their data state.

    It is that of the CasADi function of contacts and hand which the expression is for this problem.
    """
    if not isinstance(constraint, Constraint):
        return {}
    p, n = ([ca.SX.sym(f"{name}{i}", body.space) for i in range(contacts)] for name in "pn")
    variables = {} if hand is None else hand.symbols(body.bounds)
    named = {hand_variable_name(name): symbols for name, symbols in variables.items()}
    candidate = SymbolicCandidate(p, n, (0.0,) * contacts, body.size, hand=named)

    def expression(*_: Expression) -> Expression:
        return ca.vertcat(*[row.expression for row in constraint.rows(candidate)])

    try:
        return {"function": expression_digest(expression, [*p, *n, *variables.values()])}
    except (InputError, RuntimeError):  # a solve says what is wrong with it
        return {"function": unique_digest()}


def build_candidate_constraints(
    body: Body,
    constraints: Sequence[PlacementConstraint],
    hand: Hand | None,
    positions: Sequence[Expression],
    normals: Sequence[Expression],
    variables: dict[str, Expression],
) -> CandidateConstraints:
    """Return all scalar constraints of a problem, from its constraints and its hand.

    Parameters
    ----------
    body : Body
    constraints : sequence of PlacementConstraint
    hand : Hand or None
    positions, normals : sequences of k columns
        Metres, body frame; inward unit normals.
    variables : dict
        The hand's variables by name, in the hand's units.
    """
    placement = symbolic_candidate(hand, positions, normals, variables, body.size)
    symbolic = symbolic_constraints(body, constraints, hand, placement, variables)
    has_pose = hand is not None and not hand.follows_contacts
    return collect_constraints(symbolic, eliminate=has_pose)


def symbolic_constraints(
    body: Body,
    constraints: Sequence[PlacementConstraint],
    hand: Hand | None,
    placement: SymbolicCandidate,
    variables: dict[str, Expression],
) -> list[Sequence[ScalarConstraint | Clearance]]:
    """Return the scalar constraints by source: each constraint, then the hand."""
    sources = [c.rows(placement) for c in constraints]
    if hand is not None:
        sources.append([*hand.rows(placement, variables), *_tip_clearances(body, hand, placement)])
    return sources


def collect_constraints(
    groups: Sequence[Sequence[ScalarConstraint | Clearance]], eliminate: bool
) -> CandidateConstraints:
    """Return all scalar constraints in the NLP's order, with clearances through a mesh distance last."""
    constraints: list[ScalarConstraint] = []
    clearances: list[Clearance] = []
    positions: list[list[tuple[bool, int]]] = []
    for part in groups:
        positions.append([])
        for item in part:
            constraint = item.as_row() if isinstance(item, Clearance) else item
            if constraint is not None:
                positions[-1].append((True, len(constraints)))
                constraints.append(constraint)
            elif isinstance(item, Clearance):
                positions[-1].append((False, len(clearances)))
                clearances.append(item)
    sources = tuple(tuple(i if scalar else len(constraints) + i for scalar, i in part) for part in positions)
    if eliminate:
        result = _eliminate_subexpressions(constraints, clearances)
    else:
        result = CandidateConstraints(tuple(constraints), tuple(clearances))
    return replace(result, sources=sources)


def _tip_clearances(body: Body, hand: Hand, placement: SymbolicCandidate) -> list[Clearance]:
    """Return clearances that keep round fingertips out of the body away from their contacts.

    Empty for a mesh, whose roughness requires a check at each surface point instead.
    """
    if not hand.follows_contacts or not body.cramped or body.symbol is ca.MX:
        return []
    fingertips = enumerate(zip(placement.tips, placement.radii, strict=True))
    distance, size = body.distance_function, body.size
    return [
        Clearance(FINGERTIP_CLEARANCE, distance, tip, FITS * r, size, fingers=(i,))
        for i, (tip, r) in fingertips
        if r > 0.0
    ]


def _eliminate_subexpressions(constraints: list[ScalarConstraint], clearances: list[Clearance]) -> CandidateConstraints:
    """Return the constraints after elimination of common subexpressions, such as link poses."""
    expressions = ca.cse(ca.vertcat(*[r.expression for r in constraints], *[c.point for c in clearances]))
    scalars = ca.vertsplit(expressions[: len(constraints)])
    points = ca.vertsplit(expressions[len(constraints) :], 3) if clearances else []
    return CandidateConstraints(
        tuple(replace(r, expression=e) for r, e in zip(constraints, scalars, strict=True)),
        tuple(replace(c, point=p) for c, p in zip(clearances, points, strict=True)),
    )

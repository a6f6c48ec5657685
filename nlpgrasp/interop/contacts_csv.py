"""CSV export of contacts, one row per contact."""

from __future__ import annotations

import csv
import io

from nlpgrasp.interop.base import ExportFormat
from nlpgrasp.solution.solution import GraspSolution

POSITION, NORMAL = ("p_x", "p_y", "p_z"), ("n_x", "n_y", "n_z")
FRICTION, TORSION, MODEL, GRASP = "friction", "torsional_friction", "model", "grasp"


def contacts_csv(solution: GraspSolution) -> str:
    """Return the contacts of a solution as CSV text: positions, inward normals, contact models, body frame, SI units.

    Of several kept grasps all are written: the column ``grasp`` numbers them, best first, and ``mu`` is the certified
    lower bound of each. Line, plane, elliptic and bilateral contacts are named in the column ``model``, and refused on
    import, as the columns do not describe them completely.

    Raises
    ------
    InputError
        Without a grasp.
    """
    own = solution.require_grasp()
    space, several = own.space, bool(solution.others)
    kept = [(g.grasp, g.faces, g.mu) for g in solution.grasps] if several else [(own, solution.faces, solution.mu)]
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    first = [GRASP, "mu"] if several else []
    writer.writerow([*first, "finger", *POSITION[:space], *NORMAL[:space], "face", MODEL, FRICTION, TORSION])
    for number, (grasp, faces, mu) in enumerate(kept):
        named = [number, mu.lower] if several else []
        each = zip(grasp.points, grasp.normals, faces, grasp.contacts, strict=True)
        for i, (p, n, face, model) in enumerate(each):
            rough = [model.coefficients.get(name, "") for name in (FRICTION, TORSION)]
            writer.writerow([*named, i, *p.tolist(), *n.tolist(), face, model.label, *rough])
    return text.getvalue()


CSV = ExportFormat("csv", ".csv", "contacts as a table", lambda solution, _: contacts_csv(solution))

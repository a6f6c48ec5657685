"""Make the entries of the ready task library: ``python docs/make_tasks.py``.

Every number is the paper's, a standard's, or comes from the reasoning that stands beside it; none is measured.
"""

from pathlib import Path

import nlpgrasp as ng
from nlpgrasp.tasks.library.entry import Frame, ProvenanceRecord, entry_json
from nlpgrasp.tasks.library.updatable_fits import MinVolumeFit

READY = Path(__file__).resolve().parents[1] / "nlpgrasp" / "tasks" / "library" / "ready"
PAPER = "Li and Sastry 1986"
ORIGIN = [0.0, 0.0, 0.0]


def at_origin(task: ng.TaskEllipsoid) -> ng.TaskEllipsoid:
    """Return a task with moments about the body frame's origin."""
    return task.given_about(ORIGIN[: 2 if task.dimension == 3 else 3])


def entries():
    """Return name, task, tags, description, frame and source of each entry."""
    return [
        (
            "peg in hole",
            at_origin(ng.TaskEllipsoid([2.0, 1.5, 5.0, 0.12, 0.10, 0.02], center=[0.5, 0.0, -3.0, 0.0, 0.0, 0.0])),
            ("paper", "assembly", "insert"),
            "A peg is pushed into a hole, against collisions that push it back and turn it.",
            "origin in the peg's middle, z along the peg out of the hole (the paper's y)",
            f"{PAPER}, Example 3-4, (3.3-1): which components, in which order, and the offsets c1 (pushed in) and c2 "
            "(weight). The paper gives no numbers; lengths by reasoning: a peg of 20 mm by 80 mm, pushed with up to "
            "8 N, and whose ends are hit sideways with some newtons.",
        ),
        (
            "writing with a pencil",
            at_origin(ng.TaskEllipsoid([0.5, 0.5, 1.0, 0.02, 0.02, 0.002], center=[0.0, 0.0, -0.5, 0.0, 0.0, 0.0])),
            ("paper", "pencil", "write"),
            "Torque at the lead across the pencil, and a force along it that presses the lead onto the paper.",
            "origin at the lead, z along the pencil away from it (the paper's x)",
            f"{PAPER}, Example 3-5, (3.3-2): which components are large, and the offset along the pencil. The paper "
            "gives no numbers; lengths by reasoning: a lead that writes with about half a newton.",
        ),
        (
            "square with a weight",
            at_origin(ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, 0.5, 0.0])),
            ("paper", "planar", "weight"),
            "The unit ball of planar forces and torques about half a newton of weight.",
            "origin in the square's middle, y up; planar",
            f"{PAPER}, Example 3-10, (3.5-5): the unit ball about (0, weight, 0), for a square of side 2; the weight "
            "0.5 is one of those for which the example's answer holds.",
        ),
        (
            "drinking from a tea cup",
            at_origin(ng.TaskEllipsoid([0.2, 0.2, 0.2, 0.003, 0.053, 0.103], center=[0.0, 0.0, 0.981, 0.0, 0.0, 0.0])),
            ("paper", "cup", "tilt", "pour"),
            "Carry a cup of 0.1 kg, tilt it about y and turn it to the lips about z.",
            "origin in the cup's centre of mass, z up, x towards the handle",
            f"{PAPER}, Section 3.3: the cup that is held at its handle to drink; no numbers there. By reasoning: its "
            "weight, shaken by 1 m/s^2 with 0.1 N to spare; 0.05 and 0.10 N m to tilt and turn with 0.003 to spare.",
        ),
        (
            "carrying a filled cup",
            ng.lift(ORIGIN, 0.51, acceleration=5.0),
            ("paper", "cup", "carry", "lift"),
            "Carry a cup with 0.45 litres of water upright and move it about; a flat task of forces.",
            "origin in the centre of mass, z up",
            f"{PAPER}, Section 3.6: the cup that is filled; no numbers there. By reasoning: ng.lift with 0.06 kg of "
            "cup, 0.45 kg of water and 5 m/s^2 in any direction.",
        ),
        (
            "turning a screwdriver",
            at_origin(ng.TaskEllipsoid([2.0, 2.0, 10.0, 0.1, 0.1, 0.4], center=[0.0, 0.0, -15.0, 0.0, 0.0, 0.0])),
            ("tool", "screw", "turn", "press"),
            "Turn a screw either way and press the blade into it.",
            "origin at the tip, z along the shaft away from the screw",
            "By reasoning, as in problems/screwdriver.py: 0.4 N m for a small wood screw, pressed with 5 to 25 N so "
            "that the blade stays in, a little of everything else at the tip.",
        ),
        (
            "striking with a hammer",
            ng.press([0.03, 0.0, 0.13], [1.0, 0.0, 0.0], 40.0, sideways=0.1),
            ("tool", "strike", "nail"),
            "Hold against the blow on a hammer's face; a flat task of forces at the face.",
            "origin in the handle's middle, z along the handle to the head, x in the direction of the blow",
            "By reasoning, as in problems/hammer.py: ng.press with up to 40 N on the face 30 mm in front of the handle "
            "and 130 mm above its middle, a tenth of it across. Not the swing, which is a motion task.",
        ),
        (
            "cutting with a knife",
            ng.cut([0.09, 0.0, -0.025], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], 10.0),
            ("tool", "kitchen", "cut"),
            "Press a blade down on a board and draw it to and fro; a flat task of forces at the cutting point.",
            "origin in the handle's middle, x along the handle to the blade, z up",
            "By reasoning, as in problems/knife.py: ng.cut with 10 N, 90 mm in front of the handle's middle and 25 mm "
            "below it.",
        ),
        (
            "plugging in a connector",
            ng.insert([0.02, 0.0, 0.0], [1.0, 0.0, 0.0], 35.0, 5.0, 0.01),
            ("assembly", "insert", "plug"),
            "Push a plug into its socket against jams that push and turn it.",
            "origin in the plug's middle, x into the socket",
            "By reasoning: ng.insert with up to 35 N, the order of what a small plug with spring contacts takes, and a "
            "jam of 5 N over 10 mm in the socket, 20 mm in front of the plug's middle.",
        ),
        (
            "pressing a lever handle",
            ng.press([0.1, 0.0, 0.0], [0.0, 0.0, -1.0], 22.2),
            ("door", "press", "handle"),
            "Press a lever down at its end; a flat task of forces there.",
            "origin where the lever is held, x along it, z up",
            "5 lbf (22.2 N) is what the 2010 ADA Standards, 309.4, allow operable parts to ask for; 100 mm between "
            "grasp and resistance, and a fifth of it across, by reasoning (ng.press).",
        ),
        (
            "opening a bottle",
            ng.turn([0.0, 0.0, 1.0], 1.5, one_way=True),
            ("cap", "turn", "unscrew"),
            "Unscrew a cap; a torque one way alone.",
            "z out of the bottle along the cap's axis",
            "By reasoning: ng.turn with 1.5 N m, the order of what a screw cap takes, one way.",
        ),
        (
            "wiping a table",
            ng.press([0.0, 0.0, -0.03], [0.0, 0.0, -1.0], 10.0, sideways=0.5),
            ("wipe", "clean", "press"),
            "Press a sponge down and push it in any direction; a flat task of forces at its lower face.",
            "origin 30 mm above the table, z up",
            "By reasoning: ng.press with up to 10 N and half of it across, friction of a wet cloth.",
        ),
        (
            "holding 0.3 kg in any orientation",
            ng.gravity(ORIGIN, 0.3),
            ("weight", "hold", "carry"),
            "The weight of 0.3 kg from any side; a flat task of forces.",
            "origin in the centre of mass",
            "Weight alone: 0.3 kg by 9.81 m/s^2 (ng.gravity).",
        ),
        (
            "any small disturbance",
            ng.disturbance(1.0, 0.02),
            ("disturbance", "unknown", "hold"),
            "Up to one newton in any direction and 0.02 N m about any axis: where nothing is known of the task.",
            "origin in the body's middle",
            f"{PAPER}, Section 3.1: a ball, where little is known of the environment. 1 N by choice of the unit; 0.02 "
            "N m is 1 N at an arm of 20 mm.",
        ),
    ]


def made():
    """Return file names and texts of all entries."""
    result = {}
    for name, task, tags, description, frame, source in entries():
        origin = ProvenanceRecord("added", source, 0)
        words = Frame(frame, task.torque_origin)
        entry = ng.TaskEntry(name, MinVolumeFit.of_task(task), words, description, tags, (origin,))
        result[name.replace(" ", "-").replace(".", "-") + ".json"] = entry_json(entry)
    return result


if __name__ == "__main__":
    READY.mkdir(exist_ok=True)
    for file, content in made().items():
        (READY / file).write_text(content, encoding="utf-8")
        print(READY / file)

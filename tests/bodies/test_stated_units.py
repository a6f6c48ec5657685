"""Units that mesh files state: read, recorded, and not contradicted."""

import io
import re
import zipfile

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng

SIDES = np.array([2.5, 1.5, 1.0])
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="r" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


def threemf(unit, sides=SIDES):
    """Bytes of a 3MF file of a box; without an attribute ``unit`` where it is None."""
    box = trimesh.creation.box(sides)
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in box.vertices)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    attribute = "" if unit is None else f'unit="{unit}"'
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?><model {attribute} '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1" type="model">'
        f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("_rels/.rels", RELATIONS)
        archive.writestr("3D/3dmodel.model", model)
    return file.getvalue()


def collada(asset, sides=SIDES):
    """Bytes of a COLLADA file of a box, with these elements as the asset's unit and axis."""
    pytest.importorskip("collada")
    text = trimesh.creation.box(sides).export(file_type="dae")
    text = text.decode() if isinstance(text, bytes) else text
    return re.sub(r"<asset>.*?</asset>", f"<asset>{asset}</asset>", text, flags=re.DOTALL).encode()


def plain(kind, before, after, sides=SIDES):
    """Bytes of a mesh file of a box in which a text is replaced by another."""
    data = trimesh.creation.box(sides).export(file_type=kind)
    data = data.encode() if isinstance(data, str) else data
    return data.replace(before, after, 1)


def header(text):
    data = bytearray(trimesh.creation.box(SIDES).export(file_type="stl"))
    data[:80] = text.ljust(80)
    return bytes(data)


PLY = b"ply\nformat binary_little_endian 1.0\n"
FILES = {
    "none.3mf": (lambda: threemf(None, 40.0 * SIDES), 0.001, "mm"),
    "mm.3mf": (lambda: threemf("millimeter"), 0.001, "mm"),
    "micron.3mf": (lambda: threemf("micron", 1e4 * SIDES), 1e-6, "1e-06 m"),
    "cm.3mf": (lambda: threemf("centimeter"), 0.01, "cm"),
    "in.3mf": (lambda: threemf("inch"), 0.0254, "in"),
    "ft.3mf": (lambda: threemf("foot"), 0.3048, "ft"),
    "m.3mf": (lambda: threemf("meter"), 1.0, "m"),
    "in.dae": (lambda: collada('<unit name="x" meter="0.0254"/><up_axis>Y_UP</up_axis>'), 0.0254, "in"),
    "none.dae": (lambda: collada(""), 1.0, "m"),
    "YARD.DAE": (lambda: collada('<unit meter="0.9144"/>'), 0.9144, "0.9144 m"),
    "box.glb": (lambda: trimesh.creation.box(SIDES).export(file_type="glb"), 1.0, "m"),
    "mm.obj": (lambda: b"# Units: millimeters\n" + plain("obj", b"", b""), 0.001, "mm"),
    "file.obj": (lambda: b"# File units = inches\r\n" + plain("obj", b"", b""), 0.0254, "in"),
    "prose.obj": (lambda: b"# units: mm are not what these are\n" + plain("obj", b"", b""), 1.0, "m"),
    "bare.obj": (lambda: b"#units Millimetres\n" + plain("obj", b"", b""), 0.001, "mm"),
    "long.obj": (lambda: b"# Unit: Millimeter (mm).\n" + plain("obj", b"", b""), 0.001, "mm"),
    "cube.obj": (lambda: b"# unit cube\n" + plain("obj", b"", b""), 1.0, "m"),
    "cm.ply": (lambda: plain("ply", PLY, PLY + b"comment unit: cm\n"), 0.01, "cm"),
    "bare.ply": (lambda: plain("ply", PLY, PLY + b"comment length unit feet\n"), 0.3048, "ft"),
    "none.stl": (lambda: plain("stl", b"", b""), 1.0, "m"),
    "mm.stl": (lambda: header(b"COLOR=\x10\x10\x10\xff UNITS=mm"), 0.001, "mm"),
}


@pytest.mark.parametrize("name", FILES)
def test_the_unit_that_a_file_states_is_read_and_recorded(tmp_path, name):
    content, metres, unit = FILES[name]
    (tmp_path / name).write_bytes(content())
    sides = 40.0 * SIDES if name == "none.3mf" else 1e4 * SIDES if name == "micron.3mf" else SIDES
    body = ng.Mesh.load(tmp_path / name)
    np.testing.assert_allclose(np.ptp(body.bounds, axis=0), metres * sides, rtol=1e-6)
    assert body.unit == unit
    again = ng.Mesh.load(tmp_path / name, body.unit)
    assert again.to_dict() == body.to_dict()


def test_another_unit_than_the_stated_one_is_refused(tmp_path):
    (tmp_path / "in.3mf").write_bytes(threemf("inch"))
    with pytest.raises(ng.InputError, match=r"Mesh.unit: got mm, expected none: in.3mf states in; scale=0.03937"):
        ng.Mesh.load(tmp_path / "in.3mf", unit="mm")
    np.testing.assert_allclose(
        np.ptp(ng.Mesh.load(tmp_path / "in.3mf", scale=1.0 / 25.4).bounds, axis=0), 0.001 * SIDES, rtol=1e-9
    )


def test_a_file_that_states_two_units_says_so(tmp_path):
    (tmp_path / "both.obj").write_bytes(b"# units: mm\n# units: cm\n" + plain("obj", b"", b""))
    with pytest.warns(UserWarning, match=r"both.obj: its comments state 2 units: unit= says which"):
        ng.Mesh.load(tmp_path / "both.obj")


@pytest.mark.parametrize(("name", "cure"), [("m.3mf", "scale=0.001"), ("m.dae", "scale=0.001"), ("ft.3mf", "scale= ")])
def test_the_cure_of_a_wrong_stated_unit_works(tmp_path, name, cure):
    long = 16.0 * SIDES
    asset = '<unit meter="1"/>'
    units = {"m.3mf": "meter", "ft.3mf": "foot"}
    (tmp_path / name).write_bytes(threemf(units[name], long) if name in units else collada(asset, long))
    with pytest.raises(ng.InputError, match=rf"{name}, which states .* m long.*{cure}"):
        ng.Mesh.load(tmp_path / name)
    assert ng.Mesh.load(tmp_path / name, scale=0.001).size > 0.0


def test_a_unit_beside_a_converted_file_is_not_made_up_for(tmp_path, monkeypatch):
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    scene = trimesh.Scene(trimesh.creation.box(0.04 * SIDES))
    monkeypatch.setattr("trimesh.load", lambda *args, **options: scene)  # of a reader that may not be installed
    with pytest.raises(ng.InputError, match=r"got mm, expected none: part.step .* is converted to metres") as said:
        ng.Mesh.load(tmp_path / "part.step", unit="mm")
    assert "scale" not in str(said.value)


@pytest.mark.parametrize(
    "content", [lambda: threemf("furlong"), lambda: threemf(""), lambda: threemf("nan * meters")], ids=["f", "e", "nan"]
)
def test_a_unit_that_is_no_length_is_named(tmp_path, content):
    (tmp_path / "part.3mf").write_bytes(content())
    with pytest.raises(ng.InputError, match=r"part.3mf in units of .*, expected one unit of length"):
        ng.Mesh.load(tmp_path / "part.3mf")


def test_a_grasp_on_a_file_in_inches_is_verified_and_exported(tmp_path):
    (tmp_path / "in.3mf").write_bytes(threemf("inch"))
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(ng.Mesh.load(tmp_path / "in.3mf"), [ng.FrictionContact(0.5)] * 3, task)
    path = ng.solve(problem, starts=1, options=ng.SolveOptions(global_bound=False)).save(tmp_path / "grasp.json")
    assert ng.verify(path).complete
    assert '"unit": "in"' in path.read_text()
    path.write_text(path.read_text().replace('"unit": "in"', '"unit": "mm"', 1))
    report = ng.verify(path)
    assert not report.passed
    assert "in, in which in.3mf has the sha256 stated" in str(report)

"""Robot files of two-finger grippers, with and without defects."""

import trimesh

FINGER = (0.016, 0.006, 0.04)  # metres: across, thick, long; the inner faces are where the joints' origins are


BOX = '<collision><origin xyz="0 {y} 0.02"/><geometry><box size="{x} {thick} {z}"/></geometry></collision>'
SLIDE = (
    '<joint name="j{i}" type="prismatic"><parent link="palm"/><child link="f{i}"/><origin xyz="0 {y} 0.02"/>'
    '<axis xyz="0 {side} 0"/><limit lower="0" upper="0.05" effort="50" velocity="1"/></joint>'
)
FRAME = (
    '<link name="t{i}"/><joint name="k{i}" type="fixed"><parent link="f{i}"/><child link="t{i}"/>'
    '<origin xyz="0 0 0.035"/></joint>'
)
PALM = '<link name="palm"><collision><geometry><box size="0.04 0.14 0.02"/></geometry></collision></link>'


def two_fingers(folder, tip_frames=True):
    """Write a gripper of two sliding box fingers that close along y; tip frames t1 and t2 lie on the pads' faces."""
    parts = [PALM]
    for i, y, side in ((1, -0.06, 1), (2, 0.06, -1)):
        x, thick, z = FINGER
        parts.append(f'<link name="f{i}">{BOX.format(y=-0.003 * side, x=x, thick=thick, z=z)}</link>')
        parts.append(SLIDE.format(i=i, y=y, side=side))
        parts += [FRAME.format(i=i)] if tip_frames else []
    path = folder / "two.urdf"
    path.write_text(f'<robot name="two">{"".join(parts)}</robot>')
    return path


def in_millimetres(folder):
    """Write a gripper whose finger mesh is in millimetres, without a scale, and whose limits are in degrees."""
    trimesh.creation.box([20, 20, 60]).export(folder / "finger.stl")

    def finger(i, y, turn):
        return (
            f'<link name="f{i}"><collision><geometry><mesh filename="finger.stl"/></geometry></collision></link>'
            f'<joint name="j{i}" type="revolute"><parent link="palm"/><child link="f{i}"/><origin xyz="0 {y} 0.02"/>'
            f'<axis xyz="{turn} 0 0"/><limit lower="-35" upper="35" effort="5" velocity="1"/></joint>'
        )

    path = folder / "mm.urdf"
    path.write_text(f'<robot name="mm"><link name="palm"/>{finger(1, -0.05, 1)}{finger(2, 0.05, -1)}</robot>')
    return path

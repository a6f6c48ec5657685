"use strict";
// Where the links of a joint tree are: 4 by 4 transforms to the palm's frame, row after row.

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

const times = (a, b) =>
  Array.from({ length: 16 }, (_, k) => [0, 1, 2, 3].reduce((sum, i) => sum + a[4 * Math.floor(k / 4) + i] * b[4 * i + (k % 4)], 0));
const moved = (pose, p) => [0, 4, 8].map((r) => pose[r] * p[0] + pose[r + 1] * p[1] + pose[r + 2] * p[2] + pose[r + 3]);
const swung = (pose, v) => [0, 4, 8].map((r) => pose[r] * v[0] + pose[r + 1] * v[1] + pose[r + 2] * v[2]);
/** The same transform column after column, as the graphics card has it. */
const byColumns = (pose) => Float32Array.from({ length: 16 }, (_, k) => pose[4 * (k % 4) + Math.floor(k / 4)]);

/** The position of a joint, radians or metres: its driver's, or what follows from it. */
const positionOf = (joint, positions) => joint.multiplier * positions[joint.driver] + joint.offset;

/** What a joint does to its child: a turn about its axis (Rodrigues), or a way along it. */
function motion(joint, positions) {
  if (joint.kind === "fixed") return IDENTITY;
  const [x, y, z] = joint.axis, q = positionOf(joint, positions);
  if (joint.kind === "slides") return [1, 0, 0, q * x, 0, 1, 0, q * y, 0, 0, 1, q * z, 0, 0, 0, 1];
  const c = Math.cos(q), s = Math.sin(q), d = 1 - c;
  return [
    c + d * x * x, d * x * y - s * z, d * x * z + s * y, 0,
    d * x * y + s * z, c + d * y * y, d * y * z - s * x, 0,
    d * x * z - s * y, d * y * z + s * x, c + d * z * z, 0,
    0, 0, 0, 1,
  ];
}

/** The frame of a joint before it moves, for its parent's pose. */
const jointFrame = (joint, poses) => times(poses[joint.parent], [...joint.origin, 0, 0, 0, 1]);

/** The poses of all links, for positions of the drivers. */
function linkPoses(tree, positions) {
  const poses = [IDENTITY];
  for (const joint of tree.joints) poses[joint.child] = times(jointFrame(joint, poses), motion(joint, positions));
  return poses;
}

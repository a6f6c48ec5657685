"use strict";
// Shapes in world coordinates: surfaces that the page holds, and balls, discs, cones and arrows turned on a lathe.

const ROUND = 28; // sides of what is turned

function numbers(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer);
}

/** A surface of the page: positions and normals a vertex, triangles, creases as lines. */
function surfaceOf(part) {
  const faces = numbers(part.faces, part.wide ? Uint32Array : Uint16Array);
  return {
    positions: numbers(part.positions, Float32Array),
    normals: Float32Array.from(numbers(part.normals, Int16Array), (v) => v / 32767),
    faces: Uint32Array.from(faces),
    edges: numbers(part.edges, Float32Array),
  };
}

/** Triangles with a colour each: no vertex is shared. */
function patchworkOf(worth) {
  const positions = numbers(worth.positions, Float32Array);
  const colours = new Float32Array(positions.length), normals = new Float32Array(positions.length);
  worth.colours.forEach((name, i) => {
    const rgb = colourOf(worth.scale[name]);
    const [a, b, c] = [0, 3, 6].map((k) => [...positions.subarray(9 * i + k, 9 * i + k + 3)]);
    const normal = unit(cross(minus(b, a), minus(c, a)));
    for (let k = 0; k < 9; k++) [colours[9 * i + k], normals[9 * i + k]] = [rgb[k % 3], normal[k % 3]];
  });
  const faces = Uint32Array.from({ length: positions.length / 3 }, (_, i) => i);
  return { positions, normals, colours, faces, edges: new Float32Array(0) };
}

/** A profile of (radius, height) pairs turned about the line from a point along a direction; corners stay sharp. */
function turned(profile, at, along) {
  const [first, second] = across(along);
  const positions = [], normals = [], faces = [];
  for (let s = 0; s + 1 < profile.length; s++) {
    const [[r, h], [q, g]] = [profile[s], profile[s + 1]];
    const slope = Math.hypot(q - r, g - h) || 1;
    const begin = positions.length / 3;
    for (let k = 0; k <= ROUND; k++) {
      const [c, d] = [Math.cos((2 * Math.PI * k) / ROUND), Math.sin((2 * Math.PI * k) / ROUND)];
      const out = [0, 1, 2].map((i) => c * first[i] + d * second[i]);
      for (const [radius, height] of [[r, h], [q, g]]) {
        positions.push(...[0, 1, 2].map((i) => at[i] + radius * out[i] + height * along[i]));
        normals.push(...[0, 1, 2].map((i) => ((g - h) * out[i] - (q - r) * along[i]) / slope));
      }
    }
    for (let k = 0; k < ROUND; k++) {
      const a = begin + 2 * k;
      faces.push(a, a + 2, a + 3, a, a + 3, a + 1);
    }
  }
  return { positions, normals, faces };
}

function ball(at, radius) {
  const rows = 14;
  const positions = [], normals = [], faces = [];
  for (let i = 0; i <= rows; i++) {
    for (let k = 0; k <= ROUND; k++) {
      const [p, t] = [(Math.PI * i) / rows, (2 * Math.PI * k) / ROUND];
      const n = [Math.sin(p) * Math.cos(t), Math.sin(p) * Math.sin(t), Math.cos(p)];
      normals.push(...n);
      positions.push(...n.map((v, j) => at[j] + radius * v));
      const a = i * (ROUND + 1) + k;
      if (i < rows && k < ROUND) faces.push(a, a + ROUND + 1, a + ROUND + 2, a, a + ROUND + 2, a + 1);
    }
  }
  return { positions, normals, faces };
}

/** An arrow with a shaft and a head; nothing where it has no length. */
function arrow(tail, tip, width) {
  const length = norm(minus(tip, tail));
  if (length < 0.05 * width) return { positions: [], normals: [], faces: [] };
  const head = Math.min(5.5 * width, 0.6 * length), shaft = Math.min(width, 0.3 * head), neck = Math.min(2.4 * width, 0.45 * head);
  const profile = [[0, 0], [shaft, 0], [shaft, length - head], [neck, length - head], [0, length]];
  return turned(profile, tail, unit(minus(tip, tail)));
}

/** A round plate on the surface: its underside a little below the contact. */
const disc = (at, outward, radius, low, high) =>
  turned([[0, low], [radius, low], [radius, high], [0, high]], at, outward);

/** The friction cone, opening away from the body; of a planar contact a wedge in the plane. */
function cone(at, outward, height, slope, flat) {
  const tall = height / Math.max(1, slope / 1.5);
  if (!flat) return turned([[0, 0], [tall * slope, tall]], at, outward);
  const side = [-outward[1], outward[0], 0], z = 0.02 * height;
  const corner = (s, up) => [0, 1, 2].map((i) => at[i] + tall * (outward[i] + s * slope * side[i]) + (i === 2 ? up : 0));
  const positions = [z, -z].flatMap((up) => [at[0], at[1], at[2] + up, ...corner(1, up), ...corner(-1, up)]);
  return { positions, normals: positions.map((_, i) => (i % 3 === 2 ? Math.sign(9 - i) : 0)), faces: [0, 2, 1, 3, 4, 5] };
}

/** Several shapes as one. */
function together(shapes) {
  const positions = [], normals = [], faces = [];
  for (const shape of shapes) {
    const begin = positions.length / 3;
    for (const v of shape.positions) positions.push(v);
    for (const v of shape.normals) normals.push(v);
    for (const v of shape.faces) faces.push(begin + v);
  }
  return {
    positions: Float32Array.from(positions),
    normals: Float32Array.from(normals),
    faces: Uint32Array.from(faces),
    edges: new Float32Array(0),
  };
}

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const norm = (a) => Math.hypot(...a);
const unit = (a) => a.map((v) => v / (norm(a) || 1));
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const across = (n) => {
  const first = unit(cross(Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], n));
  return [first, cross(n, first)];
};
const colourOf = (hex) => [1, 3, 5].map((i) => parseInt(hex.trim().slice(i, i + 2), 16) / 255);

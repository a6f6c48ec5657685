"use strict";
// Checker of proof files, lower <= mu <= upper for one grasp and one task: docs/proof_format.md has the format and the reasons.

/**
 * Returns what a proof file (Uint8Array) proves, { lower, upper, origin, contacts, lift, cones, task }, or throws an Error
 * that names the first step that does not hold. It uses nothing from outside, so its text can be handed to a worker.
 */
function checkProof(bytes) {
  const fail = (sentence) => { throw new Error(sentence); };
  const need = (holds, sentence) => holds || fail(sentence);

  // A ball [m, r] holds the real numbers from m - r to m + r. An operation rounds m by at most |m| 2^-53, and by half of
  // the least number where a product underflows; twice that is added to r, and r is enlarged by more than its own few
  // roundings. Sums that are 0 are exact, and so are products with an exact 0. Overflow ends in an r that no test passes.
  const ROUNDING = 2 ** -52, TINY = Number.MIN_VALUE, MORE = 1 + 2 ** -49, LESS = 1 - 2 ** -49;
  const exact = (x) => [x, 0], ZERO = [0, 0];
  const minus = ([a, r]) => [-a, r];
  const plus = ([a, r], [b, s]) => [a + b, (r + s + Math.abs(a + b) * ROUNDING) * MORE];
  const times = ([a, r], [b, s]) => {
    if ((a === 0 && r === 0) || (b === 0 && s === 0)) return ZERO;
    return [a * b, (Math.abs(a) * s + Math.abs(b) * r + r * s + Math.abs(a * b) * ROUNDING) * MORE + 4 * TINY];
  };
  const inverse = ([a, r]) => { // for |a| > r, around the end that is farther from 0
    const far = 1 / (Math.abs(a) - r), near = 1 / (Math.abs(a) + r);
    return [Math.sign(a) * far, (far - near + far * 8 * ROUNDING) * MORE + TINY];
  };
  const root = ([a, r]) => { // [high, high - low]; whatever Math.sqrt gives, the squares of both decide
    const out = 1 + 2 ** -51, back = 1 - 2 ** -51, top = (a + r) * out, bottom = Math.max((a - r) * back, 0);
    let high = Math.sqrt(top) * out ** 2, low = Math.sqrt(bottom) * back ** 2;
    if (!(top === 0 || high * high * back - TINY >= top)) high = Math.max(top, 1);
    if (!(low * low * out + TINY <= bottom)) low = 0;
    return [high, (high - low) * MORE];
  };
  const sum = (terms) => terms.reduce(plus, ZERO);
  const norm = (terms) => root(sum(terms.map((x) => times(x, x))));
  const isPositive = ([m, r]) => m >= r && r < Infinity; // or 0
  const isAtLeast = (ball, other) => isPositive(plus(ball, minus(other)));

  // Words of the file: no count may be larger than what the file can have of it.
  let at = 0;
  const isSpace = (byte) => byte === 32 || (byte >= 9 && byte <= 13);
  const word = () => {
    let text = "";
    while (isSpace(bytes[at])) at++;
    while (at < bytes.length && !isSpace(bytes[at]) && text.length < 400) text += String.fromCharCode(bytes[at++]);
    return text;
  };
  const key = (name) => need(word() === name, `The word ${name} is missing before byte ${at}.`);
  const number = () => {
    const text = word(), value = Number(text), isDecimal = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(text);
    return isDecimal && Number.isFinite(value) ? value : fail(`There is no finite number before byte ${at}.`);
  };
  const index = (end, what, least = 0) => {
    const value = number();
    return Number.isInteger(value) && value >= least && value < end ? value : fail(`The ${what} before byte ${at} is out of range.`);
  };
  const count = (what, least = 1) => index(bytes.length / 2, what, least); // two bytes for each at least
  const list = (length, item) => Array.from({ length }, (_, i) => item(i));
  const entries = (height, width) => list(count("number of entries", 0), () => [index(height, "row"), index(width, "column"), exact(number())]);

  need(bytes.length < 2 ** 22, "The file is larger than 4 MB.");
  ["nlpgrasp-proof", "1", "coordinates"].forEach(key);
  const used = list(count("number of coordinates"), () => index(6, "coordinate")), d = used.length;
  need(["0,1,2,3,4,5", "0,1,5"].includes(`${used}`), "The coordinates are neither 0 1 2 3 4 5 nor 0 1 5.");
  const chosen = (wrench, what) => { // the components that are used, of numbers or balls
    need(wrench.every((x, c) => used.includes(c) || ["0", "0,0"].includes(`${x}`)), `${what} has a component that is not used.`);
    return used.map((c) => wrench[c]);
  };
  key("origin");
  const origin = list(3, number);
  key("contacts");
  const contacts = list(count("number of contacts"), () => {
    const position = list(3, number), axes = list(3, () => list(3, number));
    return { position, axes, components: list(count("number of components"), () => index(6, "component")) };
  });
  const columns = contacts.flatMap(({ position, axes, components }) => components.map((c) => { // of G
    const axis = axes[c % 3].map(exact), arm = position.map((p, i) => plus(exact(p), exact(-origin[i])));
    const moment = [[1, 2], [2, 0], [0, 1]].map(([i, j]) => plus(times(arm[i], axis[j]), minus(times(arm[j], axis[i]))));
    return chosen(c < 3 ? [...axis, ...moment] : [ZERO, ZERO, ZERO, ...axis], "A contact's wrench");
  }));
  key("variables");
  const U = index(4097, "number of variables", 1), wrenches = list(U, () => used.map(() => ZERO)); // columns of G A
  key("lift");
  const lift = entries(columns.length, U);
  for (const [i, v, x] of lift) wrenches[v] = wrenches[v].map((total, j) => plus(total, times(columns[i][j], x)));
  key("cones");
  const sizes = list(count("number of blocks"), () => count("size of a block")), R = sizes.reduce((a, b) => a + b, 0);
  need(R < bytes.length / 2, "The blocks have more rows than the file.");
  const rows = list(R, () => []), holders = list(U + 1, () => []); // of M: entries of a row, and of a variable (U: constants)
  const cones = entries(R, U + 1);
  for (const [i, v, x] of cones) {
    rows[i].push([v, x]);
    holders[v].push([i, x]);
  }
  const areInCones = (values) => {
    let start = 0;
    return sizes.every((size) => {
      const [first, ...others] = values.slice(start, (start += size));
      return isAtLeast(first, exact(norm(others)[0]));
    });
  };
  key("task");
  const task = list(count("number of parts"), () => {
    const isPolytope = index(2, "kind of a part") === 1;
    return { isPolytope, points: list(count("number of rows"), () => chosen(list(6, number), "The task")) };
  });
  const none = new Float64Array(d);
  /** Ball of <a, v>, v in balls: d products and sums round by less than d 2^-52 times the sum of the products' sizes. */
  const inner = (a, v, radii = none, start = 0) => {
    let total = 0, size = 0, off = 0;
    for (let i = 0; i < d; i++) {
      const product = a[i] * v[start + i];
      total += product;
      size += Math.abs(product);
      off += Math.abs(a[i]) * radii[start + i];
    }
    return [total, (off + size * d * ROUNDING) * MORE + 2 * d * TINY];
  };
  const support = (a) => sum(task.map(({ isPolytope, points }) => { // of the task along a
    const [first, ...others] = points.map((point) => inner(a, point));
    return isPolytope ? others.reduce(([m, r], [n, s]) => [Math.max(m, n), Math.max(r, s)], first) : plus(first, norm(others));
  }));

  key("bounds");
  const lower = number(), upper = number(), proved = { lower, upper, origin, contacts, lift, cones, task };
  need(0 <= lower && lower <= upper, "The bounds are not 0 <= lower <= upper.");
  key("upper");
  const y = chosen(list(6, number), "The direction of the upper bound"), s = list(R, () => exact(number()));
  const doneRows = new Set(), done = new Set();
  for (let pair = 0; pair < U; pair++) {
    const r = index(R, "row of a pair"), v = index(U, "variable of a pair");
    need(!doneRows.has(r) && !done.has(v), `Pair ${pair} has the row or the variable of an earlier pair.`);
    need(rows[r].every(([w]) => !done.has(w)), `The row of pair ${pair} holds the variable of an earlier pair.`);
    const [own, ...more] = holders[v].filter(([i]) => i === r), others = holders[v].filter(([i]) => i !== r);
    need(own && !more.length && own[1][0] !== 0, `Pair ${pair} has not a single entry, or it is 0.`);
    const b = wrenches[v].map((w, j) => times(w, exact(y[j])));
    s[r] = minus(times(sum([...b, ...others.map(([i, x]) => times(x, s[i]))]), inverse(own[1])));
    doneRows.add(r);
    done.add(v);
  }
  need(areInCones(s), "The multipliers of the upper bound are not in their cones.");
  const along = support(y), reach = sum(holders[U].map(([i, x]) => times(x, s[i])));
  need(along[0] > along[1], "The task's support along the direction of the upper bound is not above 0.");
  need(isAtLeast(times(exact(upper), along), reach), "The upper bound does not follow from its multipliers.");

  key("lower");
  if (lower === 0) return need(word() === "", "The file goes on after its end.") && proved;
  const centre = chosen(list(6, number), "The centre"), V = count("number of vertices"), C = count("number of cells");
  need(bytes[at++] === 10 && V <= 65536 && 8 * V * U <= bytes.length - at, "The vertices are more than the file has, or than 65536.");
  const work = [...rows, ...task.map((part) => part.points)].reduce((total, x) => total + x.length, R + d * U);
  need((V + C * d) * work < 1e9, "The check takes more than 1e9 products.");
  const data = new DataView(bytes.buffer, bytes.byteOffset), vertices = new Float64Array(V * d), radii = new Float64Array(V * d);
  for (let p = 0; p < V; p++, at += 8 * U) {
    const u = list(U, (v) => exact(data.getFloat64(at + 8 * v, true)));
    need(u.every(([x]) => Number.isFinite(x)), `Vertex ${p} has forces that are not finite.`);
    const values = rows.map((row) => sum(row.map(([v, x]) => (v < U ? times(x, u[v]) : x))));
    need(areInCones(values), `Vertex ${p} has forces that are not admissible.`);
    for (let j = 0; j < d; j++) {
      [vertices[p * d + j], radii[p * d + j]] = plus(sum(wrenches.map((w, v) => times(w[j], u[v]))), exact(-centre[j]));
    }
  }
  const byte = () => (at < bytes.length ? bytes[at++] : fail("The cells are cut off."));
  const difference = () => {
    let value = 0, group = 128;
    for (let scale = 1; group >= 128 && scale < 2 ** 35; scale *= 128) value += ((group = byte()) % 128) * scale;
    return value;
  };
  const ridges = new Set(), vertex = (a, p) => inner(a, vertices, radii, p * d); // ridges of an odd number of cells so far
  let cell = [], name = "", ray = null;
  for (let i = 0; i < C; i++) {
    const before = name;
    cell = cell.slice(0, i ? byte() : 0);
    while (cell.length < d) cell.push(difference() + (cell.length ? cell.at(-1) + 1 : 0));
    name = cell[d - 1] < V ? String.fromCharCode(...cell) : fail(`Cell ${i} has a vertex that is not in the file.`);
    if (name <= before) fail(`Cell ${i} is not after the one before it.`);
    for (let k = 0; k < d; k++) {
      const ridge = name.slice(0, k) + name.slice(k + 1);
      if (!ridges.delete(ridge)) ridges.add(ridge);
    }
    const duals = dualVectors(cell), a = used.map((_, j) => duals.reduce((total, z) => total + z[j], 0));
    const h = Math.min(...cell.map((p) => vertex(a, p)).map(([m, r]) => (m - r) * LESS));
    if (!(h > 0 && isAtLeast(plus(exact(h), inner(a, centre)), times(exact(lower), support(a))))) {
      fail(`The task times the lower bound is not in the half-space of cell ${i}.`);
    }
    if (i === 0) { // products of duals and vertices with a dominant diagonal: the vertices are independent
      const off = duals.map((z, k) => sum(cell.map((p, j) => plus(vertex(z, p), exact(j === k ? -1 : 0)).map(Math.abs))));
      need(off.every((x) => isAtLeast([0.5, 0], x)), "The vertices of the first cell may be linearly dependent.");
      const total = used.map((_, j) => sum(cell.map((p) => [vertices[p * d + j], radii[p * d + j]])));
      ray = [total.map(([m]) => m), total.map(([, r]) => r)];
      continue;
    }
    // the ray has a negative part of a vertex: its dual is 0 at the others, and a little of a makes that positive
    const parts = duals.map((z) => inner(z, ...ray)[0]), least = Math.min(...parts), share = Math.abs(inner(a, ...ray)[0]);
    const z = (duals[parts.indexOf(least)] || none).map((x, j) => x - (least / (2 * Math.max(share, -least))) * a[j]);
    const [m, r] = inner(z, ...ray);
    if (!(m < -r && cell.every((p) => isPositive(vertex(z, p))))) fail(`The ray through the first cell may meet cell ${i}.`);
  }
  need(ridges.size === 0, "The cells do not close: a ridge belongs to an odd number of them.");
  return need(at === bytes.length, "The file goes on after its end.") && proved;

  /** Vectors whose products with the vertices of a cell are about 1 for its own and 0 for the others: Gauss-Jordan, in floating point. */
  function dualVectors(cell) {
    const full = cell.map((p, i) => {
      const row = new Float64Array(2 * d);
      row.set(vertices.subarray(p * d, p * d + d));
      row[d + i] = 1;
      return row;
    });
    for (let j = 0; j < d; j++) {
      let pivot = j;
      for (let i = j + 1; i < d; i++) if (Math.abs(full[i][j]) > Math.abs(full[pivot][j])) pivot = i;
      const top = full[pivot], scale = 1 / top[j];
      [full[pivot], full[j]] = [full[j], top];
      for (let k = j; k < 2 * d; k++) top[k] *= scale;
      for (const row of full) {
        const factor = row[j];
        if (row !== top && factor !== 0) for (let k = j; k < 2 * d; k++) row[k] -= factor * top[k];
      }
    }
    return used.map((_, k) => full.map((row) => row[d + k]));
  }
}

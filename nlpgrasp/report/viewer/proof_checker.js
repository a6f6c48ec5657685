"use strict";
// Checker of proof files, lower <= mu <= upper for one grasp and one task: docs/proof_format.md has the format and the reasons.

/**
 * Returns what a proof file (Uint8Array) proves, { lower, upper, origin, contacts, lift, sizes, cones, task }, or throws an Error
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
  const inverse = (x) => [1 / x, Math.abs(1 / x) * ROUNDING + TINY];
  const sum = (terms) => terms.reduce(plus, ZERO);
  const norm = (terms) => { // [high, high - low]; whatever Math.sqrt gives, the squares of both decide
    const [a, r] = sum(terms.map((x) => times(x, x))), out = 1 + 2 ** -51, back = 1 - 2 ** -51;
    const top = (a + r) * out, bottom = Math.max((a - r) * back, 0);
    let high = Math.sqrt(top) * out ** 2, low = Math.sqrt(bottom) * back ** 2;
    if (!(top === 0 || high * high * back - TINY >= top)) high = top < 2 ** -1000 ? 2 ** -500 : Math.max(top, 1);
    if (!(low * low * out + TINY <= bottom)) low = 0;
    return [high, (high - low) * MORE];
  };
  const isAtLeast = (ball, other) => {
    const [m, r] = plus(ball, minus(other));
    return m >= r && r < Infinity;
  };

  // Words of the file: no count may be larger than what the file can have of it.
  let at = 0;
  const isSpace = (byte) => byte === 32 || byte === 9 || byte === 10 || byte === 13;
  const word = (text = "") => {
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
  need(used.every((c, i) => i === 0 || c > used[i - 1]), "The coordinates are not ascending.");
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
  const lower = number(), upper = number(), proved = { lower, upper, origin, contacts, lift, sizes, cones, task };
  need(0 <= lower && lower <= upper, "The bounds are not 0 <= lower <= upper.");
  key("upper");
  const y = chosen(list(6, number), "The direction of the upper bound"), s = list(R, () => exact(number()));
  const done = new Set(); // variables of earlier pairs
  for (let pair = 0; pair < U; pair++) {
    const r = index(R, "row of a pair"), v = index(U, "variable of a pair");
    need(rows[r].every(([w]) => !done.has(w)), `The row of pair ${pair} holds the variable of an earlier pair.`);
    const [own, ...more] = holders[v].filter(([i]) => i === r), others = holders[v].filter(([i]) => i !== r);
    need(own && !more.length && own[1][0] !== 0, `Pair ${pair} has not a single entry, or it is 0.`);
    const b = wrenches[v].map((w, j) => times(w, exact(y[j])));
    s[r] = minus(times(sum([...b, ...others.map(([i, x]) => times(x, s[i]))]), inverse(own[1][0])));
    done.add(v);
  }
  need(areInCones(s), "The multipliers of the upper bound are not in their cones.");
  const along = support(y), reach = sum(holders[U].map(([i, x]) => times(x, s[i])));
  need(along[0] > along[1], "The task's support along the direction of the upper bound is not above 0.");
  need(isAtLeast(times(exact(upper), along), reach), "The upper bound does not follow from its multipliers.");

  key("lower");
  if (lower === 0) return need(word() === "", "The file goes on after its end.") && proved;
  const V = count("number of vertices", d + 1);
  need(bytes[at++] === 10 && V <= 65536 && 8 * V * U === bytes.length - at, "The vertices are not those that the file has, or more than 65536.");
  need(V * (R + cones.length + d * U) < 1e9, "The vertices take more than 1e9 products.");
  const data = new DataView(bytes.buffer, bytes.byteOffset);
  const exerted = list(V, (p) => { // wrenches of the vertices
    const u = list(U, (v) => exact(data.getFloat64(at + 8 * (p * U + v), true)));
    need(u.every(([x]) => Number.isFinite(x)), `Vertex ${p} has forces that are not finite.`);
    need(areInCones(rows.map((row) => sum(row.map(([v, x]) => (v < U ? times(x, u[v]) : x))))), `Vertex ${p} has forces that are not admissible.`);
    return used.map((_, j) => sum(wrenches.map((w, v) => times(w[j], u[v]))));
  });
  const mean = used.map((_, j) => times(sum(list(d + 1, (p) => exerted[p][j])), inverse(d + 1)));
  const [centre, off] = [0, 1].map((end) => mean.map((x) => x[end]));
  const [vertices, radii] = [0, 1].map((end) => Float64Array.from(exerted.flatMap((w) => w.map((x, j) => plus(x, minus(mean[j]))[end]))));

  // Cells around the centre: vertices, and a direction a whose products with them are at least h above 0.
  const cells = [], directions = [], system = list(d, () => new Float64Array(d + 1)), productOf = (a, p) => inner(a, vertices, radii, p * d);
  let looks = 0;
  const add = (points) => {
    need((looks += 1000) < 4e9, "There are too many cells.");
    const a = solution(points), h = Math.min(...points.map((p) => productOf(a, p)).map(([m, r]) => (m - r) * LESS));
    if (!(h > 0)) fail(`The cell of vertices ${points.join(", ")} may hold the centre.`);
    cells.push({ points, h });
    directions.push(...a); // apart, since the search looks at all of them
  };
  const simplex = list(d + 1, (p) => p);
  for (const k of simplex) add(simplex.filter((p) => p !== k));
  for (let p = d + 1; p < V; p++) {
    looks += cells.length;
    const ridges = new Map(), v = vertices.subarray(p * d, p * d + d); // ridges of an odd number of the cells that are replaced
    for (let i = cells.length - 1; i >= 0; i--) {
      let product = 0;
      for (let j = 0; j < d; j++) product += directions[i * d + j] * v[j];
      if (product <= 1 + 1e-9) continue;
      const [m, r] = productOf(directions.slice(i * d, i * d + d), p);
      if (!(m > r)) continue;
      cells[i].points.forEach((_, k, points) => {
        const ridge = points.filter((_, j) => j !== k), name = String.fromCharCode(...ridge);
        if (!ridges.delete(name)) ridges.set(name, ridge);
      });
      directions.copyWithin(i * d, directions.length - d);
      directions.length -= d;
      cells[i] = cells.at(-1);
      cells.pop();
    }
    for (const ridge of ridges.values()) add([...ridge, p]);
  }
  cells.forEach(({ points, h }, i) => {
    const a = directions.slice(i * d, i * d + d);
    if (!isAtLeast(plus(exact(h), inner(a, centre, off)), times(exact(lower), support(a)))) {
      fail(`The task times the lower bound is not in the half-space of vertices ${points.join(", ")}.`);
    }
  });
  return proved;

  /** The vector whose products with d vertices are about 1: Gauss elimination, in floating point. */
  function solution(points) {
    points.forEach((p, i) => {
      for (let k = 0; k < d; k++) system[i][k] = vertices[p * d + k];
      system[i][d] = 1;
    });
    for (let j = 0; j < d; j++) {
      let pivot = j;
      for (let i = j + 1; i < d; i++) if (Math.abs(system[i][j]) > Math.abs(system[pivot][j])) pivot = i;
      const top = system[pivot];
      system[pivot] = system[j];
      system[j] = top;
      for (const row of system) {
        const factor = row[j] / top[j];
        if (row !== top) for (let k = j; k <= d; k++) row[k] -= factor * top[k];
      }
    }
    return system.map((row, j) => row[d] / row[j]);
  }
}

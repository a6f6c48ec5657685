"use strict";
// The page's check of its own proofs: once the page is painted, a worker checks each one, and what it proves is compared with what the page shows.

/** Numbers in a text of the page, { value, slack }: slack is half a unit of the last decimal. */
function numbersIn(text) {
  const raised = (power) => Array.from(power, (c) => (c === "⁻" ? "-" : "⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c))).join("");
  const plain = text.replaceAll("−", "-").replace(/×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, power) => `e${raised(power)}`);
  return Array.from(plain.matchAll(/-?\d+(?:\.(\d+))?(?:e-?\d+)?/g), ([number, decimals = ""]) => {
    return { value: Number(number), slack: 0.500001 * 10 ** -decimals.length };
  });
}

/** The ranges of the components of a proof's task, a [least, largest] each. */
function rangesOf({ task }) {
  const largest = (j, sign) => task.reduce((total, { isPolytope, points }) => {
    const along = points.map((point) => sign * point[j]);
    return total + (isPolytope ? Math.max(...along) : along[0] + Math.hypot(...along.slice(1)));
  }, 0);
  return task[0].points[0].map((_, j) => [-largest(j, -1), largest(j, 1)]);
}

/** Friction coefficients of a contact whose first tangential force is a component: in its cones (f u_0, u_1, u_2), not the budget's. */
function frictionsOf({ lift, sizes, cones }, component) {
  const tangential = new Set(lift.filter(([i]) => i === component).map(([, v]) => v));
  const constant = Math.max(...lift.map(([, v]) => v)) + 1, found = [];
  sizes.reduce((first, size) => {
    const block = cones.filter(([row]) => row >= first && row < first + size);
    if (block.some(([, v]) => tangential.has(v)) && !block.some(([, v]) => v === constant)) {
      found.push(...block.filter(([row, v]) => row === first && !tangential.has(v)).map(([, , [x]]) => x));
    }
    return first + size;
  }, 0);
  return found;
}

/** Sentences on where a page differs from what its proof is of; `shown` has the page's texts, as `shownIn` reads them. */
function differencesOf(proved, shown) {
  const found = [];
  const compare = (isSame, what, proof, page) => isSame || found.push(`${what}: ${proof} in the proof, ${page} on the page`);
  const say = (numbers, scale = 1) => numbers.map((x) => Number((x / scale).toPrecision(5))).join(", ");
  const isOf = (text, numbers, scale, slack = 0) => {
    const here = numbersIn(text);
    return here.length > 1 && here.every((x, i) => Math.abs(x.value - numbers[i] / scale) <= Math.max(x.slack, slack));
  };
  const isRounded = (x, y, slack = 0) => Math.abs(x - y) <= 0.00501 * Math.abs(y) + slack; // to three digits
  const [low, high = low] = numbersIn(shown.quality).map((x) => x.value);
  compare(low <= proved.upper && proved.lower <= high, "Quality", say([proved.lower, proved.upper]), shown.quality);
  const unit = shown.unit === "mm" ? 1e-3 : 1;
  compare(isOf(shown.origin, proved.origin, unit), "Point of moments", say(proved.origin, unit), shown.origin);
  compare(shown.contacts.length === proved.contacts.length, "Contacts", proved.contacts.length, shown.contacts.length);
  let end = 0;
  proved.contacts.slice(0, shown.contacts.length).forEach(({ position, axes, components }, i) => {
    const here = shown.contacts[i], start = end;
    compare(isOf(here.position, position, unit), `Position of contact ${i}`, say(position, unit), here.position);
    compare(here.drawn.every((x, j) => Math.abs(x - position[j]) < 1e-6), `Drawing of contact ${i}`, say(position), say(here.drawn));
    compare(isOf(here.normal, axes[0], 1, 1e-3), `Normal of contact ${i}`, say(axes[0]), here.normal);
    end += components.length;
    const entries = frictionsOf(proved, start + components.indexOf(1));
    const [friction] = numbersIn(/^friction (\S+)/.exec(here.coefficients)?.[1] || "");
    compare(!friction || entries.some((x) => isRounded(friction.value, x)), `Friction of contact ${i}`, "another", friction?.value);
  });
  const ranges = rangesOf(proved), size = Math.max(...ranges.flat().map(Math.abs)), stated = new Map();
  for (const [, names, both, a, b = a] of shown.task.matchAll(/([fm]_[xyz](?:, [fm]_[xyz])*) (±?)(\S+?)(?: to (\S+?))?\s/g)) {
    const ends = [both ? `-${a}` : a, b].map((text) => numbersIn(text)[0].value);
    for (const name of names.split(", ")) stated.set(name, ends);
  }
  const components = ranges.length === 3 ? ["f_x", "f_y", "m_z"] : ["f_x", "f_y", "f_z", "m_x", "m_y", "m_z"];
  components.forEach((name, j) => {
    const here = stated.get(name) || [0, 0], isSame = ranges[j].every((x, k) => isRounded(here[k], x, 2e-6 * size));
    compare(isSame, `${name} of the task`, ranges[j].map((x) => say([x])).join(" to "), here.join(" to "));
  });
  return found;
}

/** What the page says of the outcome of a check, { proved, seconds } or { reason }: { text, holds }. */
function sentenceOf({ proved, seconds, reason }, shown) {
  if (!proved) return { holds: false, text: `NOT proved: ${reason}` };
  const differences = differencesOf(proved, shown);
  if (differences.length) return { holds: false, text: `NOT proved: the proof is not of what this page shows. ${differences.join("; ")}.` };
  const outwards = (x, sign) => {
    const rounded = Number(x.toPrecision(4)), unit = x && 10 ** (Math.floor(Math.log10(x)) - 3);
    return sign * rounded >= sign * x ? rounded : Number((rounded + sign * unit).toPrecision(4));
  };
  const [least, most = least] = numbersIn(shown.quality).map((x) => x.value);
  const isNarrower = least > proved.lower * (1 + 1e-9) || most < proved.upper * (1 - 1e-9);
  const note = isNarrower ? ` The quality shown, ${shown.quality}, is narrower than this proof.` : "";
  const claim = `${outwards(proved.lower, -1)} ≤ ${shown.measure} ≤ ${outwards(proved.upper, 1)}`, time = `${seconds.toFixed(1)} s, in your browser`;
  return { holds: true, text: `This page has checked its own proof: ${claim} (${time}), for the positions, normals, friction coefficients and task shown.${note}` };
}

/** The page's texts on what its proof is of. */
function shownIn(section) {
  const figure = [...section.querySelectorAll(".fact")].find((fact) => fact.querySelector("h3").textContent === "Quality");
  const table = [...section.querySelectorAll(".of-grasp table")].find((one) => one.textContent.includes("Inward normal"));
  const drawn = JSON.parse(section.querySelector("script[type='application/json']").textContent).scenes[0]?.contacts;
  return {
    measure: section.querySelector(".proof").dataset.measure,
    quality: figure.querySelector(".value").textContent,
    task: section.querySelector(".asked").textContent,
    origin: /\(([^)]*)\)/.exec(table.caption.textContent)[1],
    unit: table.rows[0].cells[2].textContent.split(", ")[1],
    contacts: [...table.rows].slice(1).map(({ cells }, i) => {
      const [, , position, normal, , coefficients] = [...cells].map((cell) => cell.textContent);
      return { position, normal, coefficients, drawn: drawn?.[i]?.at || [] };
    }),
  };
}

/** The outcome of a check in a worker; where a page may have none, on the page. */
function checked(bytes) {
  const outcomeOf = (data) => {
    const start = performance.now();
    try {
      return { proved: checkProof(data), seconds: (performance.now() - start) / 1000 };
    } catch (error) {
      return { reason: error.message };
    }
  };
  return new Promise((resolve) => {
    const text = `${checkProof}; const outcomeOf = ${outcomeOf}; onmessage = ({ data }) => postMessage(outcomeOf(data));`;
    try {
      const worker = new Worker(URL.createObjectURL(new Blob([text])));
      worker.onmessage = ({ data }) => (worker.terminate(), resolve(data));
      worker.onerror = () => resolve(outcomeOf(bytes));
      worker.postMessage(bytes);
    } catch {
      resolve(outcomeOf(bytes));
    }
  });
}

async function checkPage() {
  for (const line of document.querySelectorAll(".proof")) {
    let said;
    try {
      const section = line.closest("section"), shown = shownIn(section);
      const bytes = Uint8Array.from(atob(section.querySelector("script[type='text/plain']").textContent), (c) => c.charCodeAt(0));
      said = sentenceOf(await checked(bytes), shown);
    } catch (error) {
      said = sentenceOf({ reason: `the page has lost a part (${error.message}).` });
    }
    line.textContent = said.text;
    line.className = said.holds ? "proof asked" : "proof status failed";
  }
}
if (typeof document !== "undefined") requestAnimationFrame(() => setTimeout(checkPage)); // after the first paint

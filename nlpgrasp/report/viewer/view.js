"use strict";
// A view of one scene at a time, out of a list: what is shown of it, from where, and labels on top.

const FIELD = (26 * Math.PI) / 180; // angle of view, upright
const MARGIN = 1.2; // around what has to be in the frame
const GLASS = { link: 0.6, tip: 0.85, obstacle: 0.45, table: 0.5 };
const renderer = new Renderer();

/** Shapes of a scene's data, made when they are first drawn. */
class Scene {
  constructor(data, worth) {
    this.data = data;
    this.worth = worth;
    this.made = new Map();
  }

  shape(name, make) {
    if (!this.made.has(name)) this.made.set(name, make());
    return this.made.get(name);
  }

  /** Layers as the renderer takes them, for what is switched on. */
  layers(shown, colours) {
    const { parts, tables, contacts, arrows, palm, lengths, size, flat } = this.data;
    const out = (c) => c.inward.map((v) => -v);
    const found = [];
    const add = (name, role, alpha, make, more = {}) =>
      found.push({ shape: this.shape(name, make), colour: colours[role], alpha, ...more });
    const mark = { mark: true };
    parts.forEach((part, i) => {
      if ((part.group === "link" || part.group === "tip") && !shown.hand) return;
      const alpha = part.group === "body" && shown.through ? 0.4 : GLASS[part.group] || 1;
      if (part.group === "body" && shown.worth && this.worth) add("worth", "body", alpha, () => patchworkOf(this.worth));
      else add(`part${i}`, part.group === "tip" ? "finger" : part.group, alpha, () => surfaceOf(part));
    });
    if (contacts.length) {
      const all = (make) => () => together(contacts.map(make));
      const thin = 0.006 * size;
      add("discs", "finger", 1, all((c) => disc(c.at, out(c), lengths.disc, -thin, 2 * thin)), mark);
      if (lengths.pad) add("pads", "link", 0.6, all((c) => disc(c.at, out(c), lengths.pad, 2 * thin, 0.07 * size)));
      if (shown.normals) {
        add("normals", "normal", 1, all((c) => arrow(c.at, c.at.map((v, i) => v + lengths.normal * c.inward[i]), 0.6 * lengths.shaft)), mark);
      }
      if (shown.cones) {
        const sliding = contacts.filter((c) => c.slope);
        add("cones", "cone", 0.35, () => together(sliding.map((c) => cone(c.at, out(c), lengths.cone, c.slope, flat))));
      }
      const round = contacts.filter((c) => c.tip > 0);
      if (round.length && shown.hand) {
        add("tips", "finger", 0.5, () => together(round.map((c) => ball(out(c).map((v, i) => c.at[i] + c.tip * v), c.tip))));
      }
      if (palm && shown.hand) {
        const rod = (c) => {
          const tip = c.at.map((v, i) => v - c.tip * c.inward[i]), way = minus(tip, palm);
          return turned([[0.3 * lengths.disc, 0], [0.3 * lengths.disc, norm(way)]], palm, unit(way));
        };
        add("palm", "link", 0.6, () => together([ball(palm, 1.2 * lengths.disc), ...contacts.map(rod)]));
      }
      if (shown.forces && arrows.length) {
        add(`arrows${shown.wrench}`, "force", 1, () => together(arrows[shown.wrench].map(([a, b]) => arrow(a, b, lengths.shaft))), mark);
      }
    }
    if (shown.triad && this.data.axes) found.push(...triad(this, this.data.axes, 0.009 * size, colours));
    tables.forEach((table, i) => {
      const [[x, y, z], r] = [table.at, table.half];
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].flatMap(([a, b]) => [x + a * r, y + b * r, z]);
      const make = () => ({ ...together([{ positions: corners, normals: [0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1], faces: [0, 1, 2, 0, 2, 3] }]) });
      add(`table${i}`, "table", 0.28, make, { grid: niceStep(r / 6), middle: [x, y, r] });
    });
    return found.sort((a, b) => (b.grid ? 1 : 0) - (a.grid ? 1 : 0));
  }
}

/** Layers of a frame's axes: an arrow each, in its own colour. */
function triad(scene, { at, ends }, width, colours) {
  return ends.map((end, i) => ({ shape: scene.shape(`triad${i}`, () => together([arrow(at, end, width)])), colour: colours["xyz"[i]], alpha: 1, mark: true }));
}

/** Where the eye is, from turn and tilt (radians): as near as the frame's points allow. */
function eyeOf(data, turn, tilt, zoom, width, height) {
  const back = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
  const right = [-Math.sin(turn), Math.cos(turn), 0], up = cross(back, right);
  const seen = data.frame.map((p) => [dot(p, right), dot(p, up), dot(p, back)]);
  const middle = [0, 1, 2].map((i) => (Math.min(...seen.map((p) => p[i])) + Math.max(...seen.map((p) => p[i]))) / 2);
  const tall = Math.tan(FIELD / 2), wide = (tall * width) / height;
  const needed = (p) => p[2] - middle[2] + MARGIN * Math.max(Math.abs(p[0] - middle[0]) / wide, Math.abs(p[1] - middle[1]) / tall);
  const distance = Math.max(...seen.map(needed), 0.2 * data.size) / zoom;
  const axes = [right, up, back], from = middle[2] + distance;
  const near = Math.max(0.02 * distance, distance - 12 * data.size), far = distance + 12 * data.size;
  const depth = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const row = [[1 / wide, right, -middle[0]], [1 / tall, up, -middle[1]], [depth[0], back, -from], [-1, back, -from]];
  const lines = row.map(([s, axis, shift], i) => [...axis.map((v) => s * v), s * shift + (i === 2 ? depth[1] : 0)]);
  const projection = Float32Array.from({ length: 16 }, (_, k) => lines[k % 4][Math.floor(k / 4)]);
  const camera = Float32Array.from({ length: 9 }, (_, k) => axes[k % 3][Math.floor(k / 3)]);
  const project = (p) => {
    const [x, y, , w] = lines.map((l) => l[0] * p[0] + l[1] * p[1] + l[2] * p[2] + l[3]);
    return [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height];
  };
  return { projection, camera, project, back };
}

class View {
  constructor(element, scenes) {
    this.element = element;
    this.scenes = scenes;
    this.canvas = element.appendChild(document.createElement("canvas"));
    this.labels = element.appendChild(document.createElement("div"));
    this.labels.className = "labels";
    this.shown = { hand: true, forces: true, normals: false, cones: false, through: false, worth: false, triad: false, wrench: 0 };
    this.show(0);
    new ResizeObserver(() => this.draw()).observe(element);
    handled(this);
  }

  /** Show one scene of the list, from its own side. */
  show(i) {
    if (this.scene) renderer.drop(this.scene.made.values());
    this.scene = this.scenes[i];
    this.reset();
    const { contacts, axes } = this.scene.data;
    const label = (known) => Object.assign(document.createElement("span"), known);
    const named = contacts.map((c, k) => label({ textContent: c.label ?? k, title: c.face }));
    const ends = (axes?.ends ?? []).map((_, i) => label({ textContent: "xyz"[i], className: `axis ${"xyz"[i]}` }));
    this.labels.replaceChildren(...named, ...ends);
    this.later();
  }

  reset() {
    const [turn, tilt] = this.scene.data.view;
    [this.turn, this.tilt, this.zoom] = [(turn * Math.PI) / 180, (tilt * Math.PI) / 180, 1];
  }

  set(name, value) {
    this.shown[name] = value;
    this.draw();
  }

  later() {
    if (!this.waiting) this.waiting = requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.waiting = 0;
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    const fine = Math.min(window.devicePixelRatio || 1, 2);
    [this.canvas.width, this.canvas.height] = [Math.round(width * fine), Math.round(height * fine)];
    this.eye = eyeOf(this.scene.data, this.turn, this.tilt, this.zoom, width, height);
    renderer.draw(this.canvas, this.scene.layers(this.shown, themeColours()), this.eye);
    this.label(width, height);
    this.element.dataset.ready ||= String(Math.round(performance.now()));
  }

  /** Put each finger's number beside its contact, and each axis' name at its end, no two on each other. */
  label(width, height) {
    const { contacts, axes, size } = this.scene.data;
    const places = contacts.map((c) => {
      const at = this.eye.project(c.at), out = this.eye.project(c.at.map((v, i) => v - (2 * c.tip + 0.06 * size) * c.inward[i]));
      const [x, y] = [out[0] - at[0], out[1] - at[1]], length = Math.hypot(x, y) || 1, aside = Math.sign(x) || 1;
      return [out[0] + (aside * 18 * y) / length, out[1] - (aside * 18 * x) / length]; // above the arrow, which comes from there
    });
    for (const end of (this.shown.triad && axes?.ends) || []) {
      const at = this.eye.project(axes.at), tip = this.eye.project(end), [x, y] = [tip[0] - at[0], tip[1] - at[1]];
      const length = Math.hypot(x, y) || 1;
      places.push([tip[0] + (7 * x - 15 * y) / length, tip[1] + (7 * y + 15 * x) / length]); // beside what lies along the axis
    }
    const half = places.map((_, i) => [Math.max(12, this.labels.children[i].offsetWidth / 2 + 1), 12]);
    for (let round = 0; round < 20; round++) {
      places.forEach((p, i) =>
        places.slice(0, i).forEach((q, j) => {
          const over = [0, 1].map((k) => half[i][k] + half[j][k] - Math.abs(p[k] - q[k]));
          if (over[0] <= 0 || over[1] <= 0) return;
          const k = over[0] < over[1] ? 0 : 1, push = (p[k] < q[k] ? -0.5 : 0.5) * over[k];
          [p[k], q[k]] = [p[k] + push, q[k] - push];
        }),
      );
    }
    places.forEach((p, i) => {
      const at = [Math.min(Math.max(p[0], half[i][0]), width - half[i][0]), Math.min(Math.max(p[1], 12), height - 12)];
      const label = this.labels.children[i];
      if (contacts[i]) label.classList.toggle("behind", dot(contacts[i].inward, this.eye.back) > 0.05);
      label.style.transform = `translate(${at[0]}px, ${at[1]}px) translate(-50%, -50%)`;
    });
    for (const label of this.labels.querySelectorAll(".axis")) label.hidden = !this.shown.triad;
  }
}

/** Turn by mouse, finger or arrow keys, zoom by wheel or plus and minus; twice clicked it is as at first. */
function handled(view) {
  const { element } = view;
  const turned = (x, y) => {
    view.turn -= x;
    view.tilt = Math.min(Math.max(view.tilt + y, -1.55), 1.55);
    view.later();
  };
  const zoomed = (by) => {
    view.zoom = Math.min(Math.max(view.zoom * by, 0.4), 6);
    view.later();
  };
  let held = null;
  element.addEventListener("pointerdown", (e) => {
    held = [e.clientX, e.clientY];
    element.setPointerCapture(e.pointerId);
  });
  element.addEventListener("pointermove", (e) => {
    if (!held) return;
    turned(0.009 * (e.clientX - held[0]), 0.009 * (e.clientY - held[1]));
    held = [e.clientX, e.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => (held = null));
  element.addEventListener("wheel", (e) => {
    if (!e.ctrlKey && document.activeElement !== element) return; // a page that scrolls past keeps scrolling
    e.preventDefault();
    zoomed(Math.exp(-0.0015 * e.deltaY));
  }, { passive: false });
  element.addEventListener("dblclick", () => (view.reset(), view.later()));
  const keys = { ArrowLeft: () => turned(0.15, 0), ArrowRight: () => turned(-0.15, 0), ArrowUp: () => turned(0, 0.12), ArrowDown: () => turned(0, -0.12), "+": () => zoomed(1.2), "-": () => zoomed(1 / 1.2), 0: () => (view.reset(), view.later()) };
  element.addEventListener("keydown", (e) => {
    if (!keys[e.key]) return;
    e.preventDefault();
    keys[e.key]();
  });
}

/** The page's colours, light or dark as it is now. */
function themeColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["body", "link", "finger", "normal", "cone", "force", "task", "obstacle", "table", "x", "y", "z"];
  return Object.fromEntries(names.map((name) => [name, colourOf(style.getPropertyValue(`--${name}`))]));
}

/** The round number next above, for a grid's step. */
const niceStep = (v) => {
  const ten = 10 ** Math.floor(Math.log10(v));
  return ten * ([1, 2, 5, 10].find((m) => m * ten >= v) || 10);
};

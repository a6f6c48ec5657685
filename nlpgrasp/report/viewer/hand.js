"use strict";
// A hand that moves: its sliders turn the joints, its buttons set postures.

const LABELS = 12; // links at the ends that are named in the scene, where no fingertips are stated
const RAISED = 0.002; // of the hand's size, that fingertips are drawn above their links

/** A hand as a scene: links and fingertips, each in its link's frame, where the joints put it. */
class HandScene {
  constructor(tree, drawn, positions) {
    [this.tree, this.drawn, this.made, this.axis] = [tree, drawn, new Map(), null];
    this.data = { size: 0.5 * drawn.size, view: drawn.view, contacts: [], axes: drawn.axes, frame: [] };
    this.move(positions);
    this.reframe();
  }

  move(positions) {
    this.positions = positions;
    this.poses = linkPoses(this.tree, positions);
    const tips = this.drawn.tips.map((tip) => ({ tip, at: moved(this.poses[tip.link], tip.at) }));
    for (const link of this.drawn.leaves.slice(0, LABELS)) tips.push({ tip: { name: this.tree.links[link], label: this.tree.links[link], radius: 0 }, at: moved(this.poses[link], [0, 0, 0]) });
    const middle = [0, 1, 2].map((i) => tips.reduce((sum, t) => sum + t.at[i], 0) / (tips.length || 1));
    this.data.contacts = tips.map(({ tip, at }) => ({ at, inward: unit(minus(middle, at)), tip: tip.radius / 2, face: tip.name, label: tip.label }));
  }

  /** Points of the hand where it is now. */
  outline() {
    const { corners, approach, axes, size } = this.drawn;
    const end = approach.at.map((v, i) => v + 0.3 * size * approach.along[i]);
    return [end, ...axes.ends, ...corners.flatMap((corner) => corner.at.map((p) => moved(this.poses[corner.link], p)))];
  }

  reframe() {
    this.data.frame = this.outline();
  }

  shape(name, make) {
    if (!this.made.has(name)) this.made.set(name, make());
    return this.made.get(name);
  }

  layers(shown, colours) {
    const { drawn, tree } = this, { size, dot } = drawn;
    const found = [];
    const add = (name, role, alpha, link, make, more = {}) =>
      found.push({ shape: this.shape(name, make), colour: colours[role], alpha, pose: link === null ? undefined : byColumns(this.poses[link]), ...more });
    const surface = (i) => () => surfaceOf(drawn.surfaces[i]);
    if (shown.links) for (const part of drawn.parts) add(`surface${part.surface}`, "link", 1, part.link, surface(part.surface));
    if (shown.tips) {
      for (const tip of drawn.tips) add(`tip${tip.surface}`, "finger", 1, tip.link, () => swollen(surfaceOf(drawn.surfaces[tip.surface]), RAISED * size));
      for (const link of drawn.leaves) add("leaf", "finger", 1, link, () => together([ball([0, 0, 0], dot)]), { mark: true });
    }
    const rod = (at, along, from, to, width) => together([arrow(at.map((v, i) => v + from * along[i]), at.map((v, i) => v + to * along[i]), width)]);
    if (shown.approach) {
      add("approach", "task", 1, 0, () => rod(drawn.approach.at, drawn.approach.along, 0, 0.3 * size, 0.007 * size), { mark: true });
    }
    if (shown.triad) found.push(...triad(this, drawn.axes, 0.005 * size, colours));
    tree.joints.forEach((joint, i) => {
      const lit = this.axis !== null && joint.driver === this.axis;
      if (joint.kind === "fixed" || !(shown.axes || lit)) return;
      const layer = { pose: byColumns(jointFrame(joint, this.poses)), mark: true };
      add(`axis${i}${lit}`, "force", 1, null, () => rod([0, 0, 0], joint.axis, lit ? -0.16 * size : 0, 0.16 * size, (lit ? 0.009 : 0.006) * size), layer);
    });
    return found;
  }
}

/** A surface moved outwards a little: what lies on another is seen whole. */
function swollen(shape, by) {
  return { ...shape, positions: shape.positions.map((v, i) => v + by * shape.normals[i]) };
}

/** A position as people read it: degrees or millimetres. */
function worded(value, turns) {
  const number = turns ? (180 / Math.PI) * value : 1000 * value, digits = Math.abs(number) < 99.95 ? 1 : 0;
  const text = number.toFixed(digits).replace(/^-(0(?:\.0)?)$/, "$1").replace("-", "\u2212");
  return turns ? `${text}\u00b0` : `${text}\u00a0mm`;
}

/** The page of a hand: its scene, sliders, switches and postures. */
class HandPage {
  constructor(data) {
    this.data = data;
    this.element = document.querySelector(".scene");
    this.scene = new HandScene(data.tree, data.drawn, [...data.postures.relaxed]);
    this.view = this.element.view = new View(this.element, [this.scene]);
    this.element.hand = this;
    this.sliders = [...document.querySelectorAll("input[data-driver]")].map((slider) => this.listened(slider));
    for (const toggle of document.querySelectorAll("input[data-show]")) {
      this.view.shown[toggle.dataset.show] = toggle.checked;
      toggle.addEventListener("change", () => this.view.set(toggle.dataset.show, toggle.checked));
    }
    for (const button of document.querySelectorAll("button[data-posture]")) {
      button.addEventListener("click", () => this.settle(data.postures[button.dataset.posture], button));
    }
    if (!renderer.gl) this.element.append("This browser draws no three-dimensional graphics (WebGL 2); everything else is below.");
    this.tell();
    this.view.draw();
  }

  listened(slider) {
    const driver = Number(slider.dataset.driver), row = slider.closest(".joint");
    slider.addEventListener("input", () => this.set(driver, Number(slider.value)));
    slider.addEventListener("change", () => this.within());
    const light = (axis) => () => {
      this.scene.axis = axis;
      this.view.later();
    };
    for (const event of ["pointerenter", "focusin"]) row.addEventListener(event, light(driver));
    for (const event of ["pointerleave", "focusout"]) row.addEventListener(event, light(null));
    return slider;
  }

  /** Put one driver where a slider is. */
  set(driver, value) {
    this.go(this.scene.positions.map((old, i) => (i === driver ? value : old)));
    this.pressed(null);
  }

  /** Put all joints into a posture, and look at it. */
  settle(positions, button) {
    this.go([...positions]);
    this.pressed(button);
    this.within();
    const { top, bottom } = this.element.getBoundingClientRect();
    if (bottom < 60 || top > innerHeight - 60) this.element.scrollIntoView({ behavior: "smooth", block: "center" });
  }

  go(positions) {
    this.scene.move(positions);
    this.tell();
    this.view.later();
  }

  pressed(button) {
    for (const other of document.querySelectorAll("button[data-posture]")) other.setAttribute("aria-pressed", String(other === button));
  }

  /** Let the camera step back where the hand has left the frame. */
  within() {
    const { clientWidth: width, clientHeight: height } = this.element;
    const left = this.scene.outline().some((p) => {
      const [x, y] = this.view.eye.project(p);
      return x < 0 || y < 0 || x > width || y > height;
    });
    if (left) this.scene.reframe();
    this.view.later();
  }

  /** Write positions beside sliders and followers. */
  tell() {
    const { drivers, joints } = this.data.tree, { positions } = this.scene;
    for (const slider of this.sliders) {
      const i = Number(slider.dataset.driver), text = worded(positions[i], drivers[i].turns);
      if (document.activeElement !== slider || Number(slider.value) !== positions[i]) slider.value = positions[i];
      slider.setAttribute("aria-valuetext", text);
      slider.closest(".joint").querySelector("output").textContent = text;
    }
    for (const output of document.querySelectorAll("output[data-joint]")) {
      const joint = joints[Number(output.dataset.joint)];
      output.textContent = worded(positionOf(joint, positions), joint.kind === "turns");
    }
  }

  /** The pose of a link in the palm's frame, 16 numbers, row after row. */
  pose(link) {
    return this.scene.poses[this.data.tree.links.indexOf(link)];
  }
}

const page = new HandPage(JSON.parse(document.querySelector("script[type='application/json']").textContent));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => page.view.draw());

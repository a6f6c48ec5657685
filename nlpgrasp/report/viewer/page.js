"use strict";
// Gives each grasp of the page its view, and its switches and slider their effect.
const views = [];
for (const section of document.querySelectorAll("section[data-grasp]")) {
  const data = JSON.parse(section.querySelector("script[type='application/json']").textContent);
  const element = section.querySelector(".scene");
  if (!element) continue;
  const body = data.scenes[0].parts.filter((part) => part.group === "body");
  for (const scene of data.scenes) if (scene.alike) scene.parts = [...body, ...scene.parts];
  const view = new View(element, data.scenes.map((scene) => new Scene(scene, data.worth)));
  element.view = view;
  views.push(view);
  if (!renderer.gl) element.append("This browser draws no three-dimensional graphics (WebGL 2); everything else is below.");
  for (const toggle of section.querySelectorAll("input[data-show]")) {
    view.shown[toggle.dataset.show] = toggle.checked;
    toggle.addEventListener("change", () => {
      view.set(toggle.dataset.show, toggle.checked);
      const scale = section.querySelector(".scale");
      if (toggle.dataset.show === "worth" && scale) scale.hidden = !toggle.checked;
    });
  }
  let told = data; // labels and fingers of the grasp that is shown
  const slider = section.querySelector("input[type='range']");
  const slid = () => {
    const i = Number(slider.value);
    view.set("wrench", i);
    slider.setAttribute("aria-valuetext", told.labels[i]);
    section.querySelector("output").textContent = told.labels[i];
    section.querySelectorAll(".finger").forEach((row, k) => {
      row.querySelector(".words").textContent = told.fingers[i][k].words;
      row.querySelector(".bar span").style.width = `${100 * told.fingers[i][k].share}%`;
    });
    element.dataset.shown = String(i);
  };
  slider?.addEventListener("input", slid);
  for (const button of section.querySelectorAll("button[data-grasp-number]")) {
    button.addEventListener("click", () => {
      const number = Number(button.dataset.graspNumber);
      told = data.grasps[number];
      section.querySelector(".panel").outerHTML = told.panel;
      section.querySelector(".of-grasp").outerHTML = told.tables;
      section.querySelector(".proof")?.toggleAttribute("hidden", number > 0); // of the first grasp
      section.querySelectorAll("button[data-grasp-number]").forEach((b) => b.setAttribute("aria-pressed", String(b === button)));
      element.dataset.grasp = String(number);
      [slider.value, slider.max] = [0, told.labels.length - 1];
      view.shown.wrench = 0;
      view.show(number);
      slid();
    });
  }
}
// small scenes, of other grasps and beside the rows of a comparison
for (const canvas of document.querySelectorAll("canvas[data-of]")) {
  views.push({
    draw() {
      const { clientWidth: width, clientHeight: height } = canvas;
      const view = document.getElementById(canvas.dataset.of)?.view;
      if (!view) return;
      [canvas.width, canvas.height] = [2 * width, 2 * height];
      const scene = view.scenes[Number(canvas.dataset.scene || 0)];
      const [turn, tilt] = scene.data.view.map((v) => (v * Math.PI) / 180);
      const shown = { hand: true, forces: true, wrench: 0 };
      renderer.draw(canvas, scene.layers(shown, themeColours()), eyeOf(scene.data, turn, tilt, 1, width, height));
    },
  });
  views.at(-1).draw();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => views.forEach((view) => view.draw()));

"use strict";
// Gives each grasp of the page its view, and its switches and slider their effect.
const views = [];
for (const section of document.querySelectorAll("section[data-grasp]")) {
  const data = JSON.parse(section.querySelector("script[type='application/json']").textContent);
  const element = section.querySelector(".scene");
  if (!element) continue;
  const view = new View(element, data.scenes.map((scene) => new Scene(scene, data.worth)));
  element.view = view;
  views.push(view);
  if (!renderer.gl) element.append("This browser draws no three-dimensional graphics (WebGL 2); everything else is below.");
  for (const toggle of section.querySelectorAll("input[data-show]")) {
    toggle.addEventListener("change", () => {
      view.set(toggle.dataset.show, toggle.checked);
      const scale = section.querySelector(".scale");
      if (toggle.dataset.show === "worth" && scale) scale.hidden = !toggle.checked;
    });
  }
  const slider = section.querySelector("input[type='range']");
  if (!slider) continue;
  slider.addEventListener("input", () => {
    const i = Number(slider.value);
    view.set("wrench", i);
    slider.setAttribute("aria-valuetext", data.labels[i]);
    section.querySelector("output").textContent = data.labels[i];
    section.querySelectorAll(".finger").forEach((row, k) => {
      row.querySelector(".words").textContent = data.fingers[i][k].words;
      row.querySelector(".bar span").style.width = `${100 * data.fingers[i][k].share}%`;
    });
    element.dataset.shown = String(i);
  });
}
// small scenes beside the rows of a comparison
for (const canvas of document.querySelectorAll("canvas[data-of]")) {
  views.push({
    draw() {
      const { clientWidth: width, clientHeight: height } = canvas;
      const view = document.getElementById(canvas.dataset.of)?.view;
      if (!view) return;
      [canvas.width, canvas.height] = [2 * width, 2 * height];
      const [turn, tilt] = view.scenes[0].data.view.map((v) => (v * Math.PI) / 180);
      const shown = { hand: true, forces: true, wrench: 0 };
      renderer.draw(canvas, view.scenes[0].layers(shown, themeColours()), eyeOf(view.scenes[0].data, turn, tilt, 1, width, height));
    },
  });
  views.at(-1).draw();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => views.forEach((view) => view.draw()));

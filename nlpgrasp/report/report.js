"use strict";
// Draws each scene and moves its arrows to the task wrench that the slider names.
for (const section of document.querySelectorAll("section[data-grasp]")) {
  const data = JSON.parse(section.querySelector("script[type='application/json']").textContent);
  const scene = section.querySelector(".scene");
  const axis = { visible: false, showspikes: false };
  const layout = {
    autosize: true,
    margin: { l: 0, r: 0, t: 0, b: 0 },
    paper_bgcolor: "#fff",
    showlegend: false,
    scene: { aspectmode: "data", xaxis: axis, yaxis: axis, zaxis: axis, camera: { eye: { x: 1.1, y: 1.1, z: 0.8 } } },
  };
  const words = (i) => [data.labels[i], ...data.fingers[i]].join("; ");
  Plotly.newPlot(scene, data.traces, layout, { responsive: true, displaylogo: false }).then(() => {
    scene.dataset.ready = String(Math.round(performance.now()));
  });
  const worth = section.querySelector("input[data-worth]");
  if (worth) {
    worth.addEventListener("change", () => {
      const opaque = worth.checked ? 1 : data.traces[0].opacity;
      Plotly.restyle(scene, { facecolor: [worth.checked ? data.worth : null], opacity: opaque }, [0]);
      scene.dataset.worth = String(worth.checked);
    });
  }
  const slider = section.querySelector("input[type='range']");
  if (!slider) continue;
  const shafts = data.traces.length - 2;
  const show = () => {
    const i = Number(slider.value);
    const [lines, heads] = data.arrows[i];
    for (const [trace, to] of [[shafts, lines], [shafts + 1, heads]]) {
      Plotly.restyle(scene, { x: [to.x], y: [to.y], z: [to.z] }, [trace]);
    }
    slider.setAttribute("aria-valuetext", data.labels[i]);
    section.querySelector("output").textContent = words(i);
    scene.dataset.shown = String(i);
  };
  slider.addEventListener("input", show);
}

"use strict";
// Draws any number of scenes with one graphics context, each copied to the canvas it belongs to.

const VERTEX = `#version 300 es
in vec3 position, normal, colour;
uniform mat4 projection, pose;
uniform mat3 camera;
out vec3 n, c, w;
void main() {
  n = camera * mat3(pose) * normal;
  c = colour;
  w = (pose * vec4(position, 1.0)).xyz;
  gl_Position = projection * vec4(w, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 n, c, w;
uniform float alpha, grid, lit;
uniform vec3 middle;
out vec4 shown;
void main() {
  vec3 m = normalize(gl_FrontFacing ? n : -n);
  float key = max(dot(m, normalize(vec3(-0.4, 0.85, 0.55))), 0.0), fill = max(dot(m, normalize(vec3(0.8, -0.1, 0.45))), 0.0);
  float shine = pow(max(dot(m, normalize(vec3(-0.3, 0.45, 1.3))), 0.0), 40.0);
  vec3 colour = lit > 0.5 ? c * (0.66 + 0.42 * key + 0.14 * fill) + 0.06 * shine : c;
  float seen = alpha;
  if (grid > 0.0) {
    float far = length(w.xy - middle.xy) / middle.z;
    vec2 cell = abs(fract(w.xy / grid - 0.5) - 0.5) / max(fwidth(w.xy / grid), 1e-6);
    float line = 1.0 - min(min(cell.x, cell.y), 1.0);
    seen = (alpha + 0.3 * line) * (1.0 - smoothstep(0.35, 1.0, far));
  }
  shown = vec4(colour * seen, seen);
}`;

const UNMOVED = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

class Renderer {
  constructor() {
    this.canvas = document.createElement("canvas");
    const gl = this.canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
    this.gl = gl;
    this.kept = new Map();
    if (!gl) return;
    const program = (this.program = gl.createProgram());
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["position", "normal", "colour"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
    gl.linkProgram(program);
    gl.useProgram(program);
    this.at = Object.fromEntries(
      ["projection", "pose", "camera", "alpha", "grid", "lit", "middle"].map((name) => [name, gl.getUniformLocation(program, name)]),
    );
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.polygonOffset(1, 1);
  }

  /** Draw layers, each a shape with its look, into a canvas: solid ones, marks faintly through them, then glass. */
  draw(target, layers, eye) {
    const gl = this.gl;
    const { width, height } = target;
    if (!gl || !width || !height) return;
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(this.at.projection, false, eye.projection);
    gl.uniformMatrix3fv(this.at.camera, false, eye.camera);
    const solid = layers.filter((l) => l.alpha >= 1), glass = layers.filter((l) => l.alpha < 1);
    for (const layer of solid.filter((l) => !l.mark)) this.fill(layer, 1);
    gl.depthFunc(gl.GREATER);
    gl.depthMask(false);
    gl.enable(gl.CULL_FACE);
    for (const layer of solid.filter((l) => l.mark)) this.fill(layer, 0.25);
    gl.disable(gl.CULL_FACE);
    gl.depthMask(true);
    gl.depthFunc(gl.LEQUAL);
    for (const layer of solid.filter((l) => l.mark)) this.fill(layer, 1);
    for (const layer of glass) {
      gl.colorMask(false, false, false, false);
      if (!layer.grid) this.fill(layer, 1);
      gl.colorMask(true, true, true, true);
      gl.depthMask(!layer.grid);
      this.fill(layer, layer.alpha);
      gl.depthMask(true);
    }
    const flat = target.getContext("2d");
    flat.clearRect(0, 0, width, height);
    flat.drawImage(this.canvas, 0, 0);
  }

  fill(layer, alpha) {
    const gl = this.gl, held = this.held(layer.shape);
    gl.bindVertexArray(held.array);
    if (!layer.shape.colours) gl.vertexAttrib3fv(2, layer.colour);
    gl.uniformMatrix4fv(this.at.pose, false, layer.pose || UNMOVED);
    gl.uniform1f(this.at.alpha, alpha);
    gl.uniform1f(this.at.lit, layer.grid ? 0 : 1);
    gl.uniform1f(this.at.grid, layer.grid || 0);
    if (layer.grid) gl.uniform3fv(this.at.middle, layer.middle);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.drawElements(gl.TRIANGLES, layer.shape.faces.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    if (!held.lines || alpha < 0.3) return;
    gl.bindVertexArray(held.lines);
    gl.vertexAttrib3fv(2, layer.colour.map((v) => 0.55 * v));
    gl.uniform1f(this.at.lit, 0);
    gl.uniform1f(this.at.alpha, 0.7 * alpha);
    gl.drawArrays(gl.LINES, 0, layer.shape.edges.length / 3);
  }

  /** The shape on the graphics card, put there once. */
  held(shape) {
    if (this.kept.has(shape)) return this.kept.get(shape);
    const gl = this.gl, buffers = [];
    const array = (parts) => {
      const made = gl.createVertexArray();
      gl.bindVertexArray(made);
      parts.forEach((values, i) => {
        if (!values) return;
        buffers.push(gl.createBuffer());
        gl.bindBuffer(gl.ARRAY_BUFFER, buffers.at(-1));
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        gl.enableVertexAttribArray(i);
        gl.vertexAttribPointer(i, 3, gl.FLOAT, false, 0, 0);
      });
      return made;
    };
    const found = { array: array([shape.positions, shape.normals, shape.colours]), buffers };
    buffers.push(gl.createBuffer());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.at(-1));
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, shape.faces, gl.STATIC_DRAW);
    if (shape.edges.length) found.lines = array([shape.edges]);
    this.kept.set(shape, found);
    return found;
  }

  /** Take shapes off the graphics card that nothing draws any more. */
  drop(shapes) {
    for (const shape of shapes) {
      const held = this.kept.get(shape);
      if (!held) continue;
      held.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
      for (const array of [held.array, held.lines]) if (array) this.gl.deleteVertexArray(array);
      this.kept.delete(shape);
    }
  }
}

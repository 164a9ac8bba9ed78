"use strict";
// A small orbit viewer on WebGL 2. The page is one file and asks for nothing from outside.
(function () {
  const canvas = document.getElementById("viewer");
  const note = document.getElementById("viewer-note");
  const scene = JSON.parse(document.getElementById("scene").textContent);

  function fail(message) {
    canvas.dataset.status = "failed";
    note.textContent = message;
    const still = document.getElementById("still");
    if (still) { canvas.hidden = true; still.hidden = false; }
  }

  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) { fail("This browser has no WebGL 2: an animation is shown instead."); return; }

  function decode(text, Type) {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Type(bytes.buffer);
  }

  function shader(kind, source) {
    const s = gl.createShader(kind);
    gl.shaderSource(s, source);
    gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
    return s;
  }

  function program(vertex, fragment) {
    const p = gl.createProgram();
    gl.attachShader(p, shader(gl.VERTEX_SHADER, vertex));
    gl.attachShader(p, shader(gl.FRAGMENT_SHADER, fragment));
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));
    return p;
  }

  const surface = program(
    `#version 300 es
    in vec3 position; in vec3 normal; in vec3 color; in vec2 uv;
    uniform mat4 view; uniform mat4 projection;
    out vec3 v_normal; out vec3 v_color; out vec2 v_uv;
    void main() {
      vec4 p = view * vec4(position, 1.0);
      v_normal = mat3(view) * normal; v_color = color; v_uv = uv;
      gl_Position = projection * p;
    }`,
    `#version 300 es
    precision highp float;
    in vec3 v_normal; in vec3 v_color; in vec2 v_uv;
    uniform sampler2D image; uniform int mode; uniform bool textured;
    out vec4 pixel;
    void main() {
      vec3 n = normalize(v_normal);
      if (!gl_FrontFacing) n = -n;
      vec3 base = textured ? texture(image, v_uv).rgb : v_color;
      float key = max(dot(n, normalize(vec3(0.4, 0.7, 0.8))), 0.0);
      float fill = max(dot(n, normalize(vec3(-0.7, 0.1, 0.5))), 0.0);
      float light = 0.35 + 0.6 * key + 0.2 * fill;
      if (mode == 0) pixel = vec4(base, 1.0);
      else if (mode == 1) pixel = vec4(base * light, 1.0);
      else if (mode == 2) pixel = vec4(vec3(0.82, 0.83, 0.86) * light, 1.0);
      else pixel = vec4(0.5 * n + 0.5, 1.0);
    }`);
  const wire = program(
    `#version 300 es
    in vec3 position; uniform mat4 view; uniform mat4 projection;
    void main() {
      gl_Position = projection * view * vec4(position, 1.0);
      gl_Position.z -= 0.0004 * gl_Position.w;
    }`,
    `#version 300 es
    precision highp float; out vec4 pixel;
    void main() { pixel = vec4(0.05, 0.35, 0.75, 1.0); }`);

  const positions = decode(scene.positions, Float32Array);
  const normals = decode(scene.normals, Float32Array);
  const colors = scene.colors ? decode(scene.colors, Uint8Array) : null;
  const uvs = scene.uvs ? decode(scene.uvs, Float32Array) : null;
  const faces = decode(scene.faces, Uint32Array);

  function attribute(location, data, size, type, normalized) {
    if (location < 0) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalized, 0, 0);
  }

  const solid = gl.createVertexArray();
  gl.bindVertexArray(solid);
  attribute(gl.getAttribLocation(surface, "position"), positions, 3, gl.FLOAT, false);
  attribute(gl.getAttribLocation(surface, "normal"), normals, 3, gl.FLOAT, false);
  if (colors) attribute(gl.getAttribLocation(surface, "color"), colors, 3, gl.UNSIGNED_BYTE, true);
  else gl.vertexAttrib3f(gl.getAttribLocation(surface, "color"), 0.75, 0.75, 0.78);
  if (uvs) attribute(gl.getAttribLocation(surface, "uv"), uvs, 2, gl.FLOAT, false);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);

  const lines = new Uint32Array(faces.length * 2);
  for (let f = 0; f < faces.length; f += 3) {
    lines.set([faces[f], faces[f + 1], faces[f + 1], faces[f + 2], faces[f + 2], faces[f]], 2 * f);
  }
  const edges = gl.createVertexArray();
  gl.bindVertexArray(edges);
  attribute(gl.getAttribLocation(wire, "position"), positions, 3, gl.FLOAT, false);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, lines, gl.STATIC_DRAW);

  let textured = false;
  const image = gl.createTexture();
  if (uvs && scene.texture) {
    const picture = new Image();
    picture.onload = function () {
      gl.bindTexture(gl.TEXTURE_2D, image);
      gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, picture);
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      textured = true;
      draw();
      note_pixels();
    };
    picture.src = scene.texture;
  }

  // The page says what is shown first: colours where the mesh has some, else its shape.
  const shading = document.getElementById("shading");
  const state = { azimuth: 0.6, elevation: 0.3, zoom: 1, mode: +shading.value, wires: false, spin: true };
  const still = window.matchMedia && window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (still) state.spin = false;

  function view(distance) {
    const ca = Math.cos(state.azimuth), sa = Math.sin(state.azimuth);
    const ce = Math.cos(state.elevation), se = Math.sin(state.elevation);
    const c = scene.center;
    // Rows of the rotation: right, up, backward.
    const r = [ca, 0, -sa], u = [-sa * se, ce, -ca * se], b = [sa * ce, se, ca * ce];
    const dot = (a) => a[0] * c[0] + a[1] * c[1] + a[2] * c[2];
    return new Float32Array([
      r[0], u[0], b[0], 0, r[1], u[1], b[1], 0, r[2], u[2], b[2], 0,
      -dot(r), -dot(u), -dot(b) - distance, 1]);
  }

  function projection(aspect, near, far) {
    const f = 1 / Math.tan(0.35), d = near - far;
    const fx = aspect < 1 ? f : f / aspect, fy = aspect < 1 ? f * aspect : f;
    return new Float32Array([
      fx, 0, 0, 0, 0, fy, 0, 0, 0, 0, (far + near) / d, -1, 0, 0, 2 * far * near / d, 0]);
  }

  function draw() {
    const scale = window.devicePixelRatio || 1;
    const w = Math.max(1, Math.round(canvas.clientWidth * scale));
    const h = Math.max(1, Math.round(canvas.clientHeight * scale));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const distance = scene.radius * 3.1 / state.zoom;
    const v = view(distance);
    const p = projection(w / h, distance * 0.05, distance + 4 * scene.radius);
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(surface);
    gl.uniformMatrix4fv(gl.getUniformLocation(surface, "view"), false, v);
    gl.uniformMatrix4fv(gl.getUniformLocation(surface, "projection"), false, p);
    gl.uniform1i(gl.getUniformLocation(surface, "mode"), state.mode);
    gl.uniform1i(gl.getUniformLocation(surface, "textured"), textured ? 1 : 0);
    gl.bindTexture(gl.TEXTURE_2D, image);
    gl.bindVertexArray(solid);
    gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
    if (state.wires) {
      gl.useProgram(wire);
      gl.uniformMatrix4fv(gl.getUniformLocation(wire, "view"), false, v);
      gl.uniformMatrix4fv(gl.getUniformLocation(wire, "projection"), false, p);
      gl.bindVertexArray(edges);
      gl.drawElements(gl.LINES, lines.length, gl.UNSIGNED_INT, 0);
    }
  }

  // How many pixels the mesh covers, their mean colour, and how much their brightness varies: what an automatic check
  // of this page reads.
  function note_pixels() {
    const bytes = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const sum = [0, 0, 0];
    let count = 0, light = 0, squared = 0;
    for (let i = 0; i < bytes.length; i += 4) {
      if (bytes[i + 3] !== 255) continue;
      count++;
      for (let k = 0; k < 3; k++) sum[k] += bytes[i + k];
      const grey = (bytes[i] + bytes[i + 1] + bytes[i + 2]) / 3;
      light += grey;
      squared += grey * grey;
    }
    const n = Math.max(count, 1);
    canvas.dataset.pixels = String(count);
    canvas.dataset.mean = sum.map((s) => (s / n).toFixed(1)).join(" ");
    canvas.dataset.spread = Math.sqrt(Math.max(squared / n - (light / n) ** 2, 0)).toFixed(2);
  }

  let last = 0;
  function frame(time) {
    if (state.spin) {
      state.azimuth += Math.min(time - last, 50) * 0.0005;
      draw();
    }
    last = time;
    requestAnimationFrame(frame);
  }

  let grip = null;
  canvas.addEventListener("pointerdown", (e) => {
    grip = [e.clientX, e.clientY];
    canvas.setPointerCapture(e.pointerId);
    state.spin = false;
    document.getElementById("spin").checked = false;
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!grip) return;
    state.azimuth -= (e.clientX - grip[0]) * 0.01;
    state.elevation = Math.max(-1.55, Math.min(1.55, state.elevation + (e.clientY - grip[1]) * 0.01));
    grip = [e.clientX, e.clientY];
    draw();
  });
  canvas.addEventListener("pointerup", () => { grip = null; });
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    state.zoom = Math.max(0.3, Math.min(8, state.zoom * Math.exp(-e.deltaY * 0.001)));
    draw();
  }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (!step) return;
    e.preventDefault();
    state.azimuth += step[0];
    state.elevation = Math.max(-1.55, Math.min(1.55, state.elevation + step[1]));
    draw();
  });
  shading.addEventListener("change", (e) => { state.mode = +e.target.value; draw(); });
  document.getElementById("wires").addEventListener("change", (e) => { state.wires = e.target.checked; draw(); });
  const spin = document.getElementById("spin");
  spin.checked = state.spin;
  spin.addEventListener("change", (e) => { state.spin = e.target.checked; });
  window.addEventListener("resize", draw);

  draw();
  note_pixels();
  canvas.dataset.status = "drawn";
  requestAnimationFrame(frame);
})();

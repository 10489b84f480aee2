// The report's 3D view: WebGL 1, no libraries, no network. Reads the JSON in #view-data (pipeline/html_view.cc
// writes it), draws into #view-canvas, and says in #view-status what it drew.
(function () {
  'use strict';
  const byId = (id) => document.getElementById(id);
  const status = byId('view-status');
  const canvas = byId('view-canvas');
  const data = JSON.parse(byId('view-data').textContent);
  const NOT_MEASURED = -32768;

  const gl = canvas.getContext('webgl', {antialias: true, alpha: false});
  if (!gl) {
    status.textContent = 'no WebGL in this browser: the pictures below show the same surfaces';
    return;
  }
  const bigIndices = gl.getExtension('OES_element_index_uint');

  // ---- data -------------------------------------------------------------------------------------------------

  function bytesOf(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
    return bytes.buffer;
  }

  // Numbers are little endian in the file; every platform with WebGL is.
  function unpack(mesh) {
    const q = new Uint16Array(bytesOf(mesh.positions));
    const positions = new Float32Array(q.length);
    for (let i = 0; i < q.length; ++i) positions[i] = mesh.low_mm[i % 3] + q[i] / 65535 * mesh.size_mm[i % 3];
    const buffer = bytesOf(mesh.indices);
    const indices = mesh.wide ? new Uint32Array(buffer) : new Uint16Array(buffer);
    return {positions, indices, normals: normalsOf(positions, indices)};
  }

  function normalsOf(p, index) {
    const n = new Float32Array(p.length);
    for (let t = 0; t < index.length; t += 3) {
      const a = 3 * index[t], b = 3 * index[t + 1], c = 3 * index[t + 2];
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      for (const k of [a, b, c]) { n[k] += x; n[k + 1] += y; n[k + 2] += z; }
    }
    for (let i = 0; i < n.length; i += 3) {
      const length = Math.hypot(n[i], n[i + 1], n[i + 2]) || 1;
      n[i] /= length; n[i + 1] /= length; n[i + 2] /= length;
    }
    return n;
  }

  // A model that several splints share is packed once: "same_as" names its place.
  for (const mesh of data.meshes) if (mesh.same_as !== undefined) mesh.shape = data.meshes[mesh.same_as];

  // ---- drawing ----------------------------------------------------------------------------------------------

  const vertexShader = `
    attribute vec3 position; attribute vec3 normal; attribute vec2 value;
    uniform mat4 eyeFromScene; uniform mat4 sceneFromMesh; uniform vec3 clipScale;
    varying vec3 eyeNormal; varying vec2 shown;
    void main() {
      vec4 eye = eyeFromScene * (sceneFromMesh * vec4(position, 1.0));
      eyeNormal = (eyeFromScene * (sceneFromMesh * vec4(normal, 0.0))).xyz;
      shown = value;
      gl_Position = vec4(eye.xyz * clipScale, 1.0);
    }`;
  const fragmentShader = `
    precision mediump float;
    varying vec3 eyeNormal; varying vec2 shown;
    uniform vec4 color; uniform float rangeMicrometres; uniform bool coloured; uniform sampler2D colourMap;
    uniform vec3 notMeasured;
    void main() {
      vec3 n = normalize(gl_FrontFacing ? eyeNormal : -eyeNormal);
      float light = 0.30 + 0.62 * max(dot(n, normalize(vec3(-0.35, 0.5, 0.8))), 0.0)
                  + 0.22 * max(dot(n, normalize(vec3(0.7, -0.2, 0.6))), 0.0);
      vec3 base = color.rgb;
      if (coloured) {
        float u = clamp(0.5 + 0.5 * shown.x / rangeMicrometres, 0.002, 0.998);
        base = shown.y < 0.99 ? notMeasured : texture2D(colourMap, vec2(u, 0.5)).rgb;
      }
      // Colours that are read against the legend keep most of themselves.
      if (coloured) light = 0.55 + 0.45 * light;
      gl_FragColor = vec4(min(base * light, 1.0), color.a);
    }`;

  function compile(type, text) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  }
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl.VERTEX_SHADER, vertexShader));
  gl.attachShader(program, compile(gl.FRAGMENT_SHADER, fragmentShader));
  gl.linkProgram(program);
  gl.useProgram(program);
  const attribute = (name) => gl.getAttribLocation(program, name);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const at = {position: attribute('position'), normal: attribute('normal'), value: attribute('value')};
  const set = {};
  for (const name of ['eyeFromScene', 'sceneFromMesh', 'clipScale', 'color', 'rangeMicrometres', 'coloured',
                      'colourMap', 'notMeasured'])
    set[name] = uniform(name);

  const colours = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; ++i) {
    for (let k = 0; k < 3; ++k) colours[4 * i + k] = parseInt(data.colour_map.substr(6 * i + 2 * k, 2), 16);
    colours[4 * i + 3] = 255;
  }
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, colours);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);

  function bufferOf(target, array) {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, array, gl.STATIC_DRAW);
    return buffer;
  }
  function upload(mesh) {
    if (mesh.shape) {
      mesh.gpu = upload(mesh.shape);
      mesh.cpu = mesh.shape.cpu;
      mesh.wide = mesh.shape.wide;
    }
    if (mesh.gpu) return mesh.gpu;
    const cpu = mesh.cpu = unpack(mesh);
    if (mesh.wide && !bigIndices) throw new Error('this browser cannot draw more than 65536 vertices at once');
    mesh.gpu = {
      positions: bufferOf(gl.ARRAY_BUFFER, cpu.positions),
      normals: bufferOf(gl.ARRAY_BUFFER, cpu.normals),
      indices: bufferOf(gl.ELEMENT_ARRAY_BUFFER, cpu.indices),
      count: cpu.indices.length,
      fields: {},
    };
    return mesh.gpu;
  }
  function fieldBuffer(mesh, field) {
    const gpu = upload(mesh);
    if (!gpu.fields[field.procedure]) {
      field.cpu = new Int16Array(bytesOf(field.values_um));
      // Distance and whether it is known: between a known and an unknown vertex nothing is shown.
      const pairs = new Float32Array(2 * field.cpu.length);
      field.cpu.forEach((um, i) => {
        pairs[2 * i + 1] = um === NOT_MEASURED ? 0 : 1;
        pairs[2 * i] = um === NOT_MEASURED ? 0 : um;
      });
      gpu.fields[field.procedure] = bufferOf(gl.ARRAY_BUFFER, pairs);
    }
    return gpu.fields[field.procedure];
  }

  const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];  // row-major, as in the file
  const columns = (m) => new Float32Array([0, 1, 2, 3].flatMap((c) => [0, 1, 2, 3].map((r) => m[4 * r + c])));

  // ---- state ------------------------------------------------------------------------------------------------

  // Turn: rows are the eye's right, up and towards-viewer axes in the scene. Lengths in mm.
  const state = {turn: null, centre: [0, 0, 0], half: 40, splint: 0, procedure: data.procedures.length ? 0 : -1,
                 range: data.range_mm, hidden: {}};
  const views = {};  // name → [right, up, towards]
  for (const view of data.views) views[view.name] = view.axes;

  function chosenProcedure() {
    return state.procedure >= 0 ? data.procedures[state.procedure].name : null;
  }
  // What the present choice shows: [mesh, field or null].
  function shownLayers() {
    const wanted = chosenProcedure(), layers = [];
    for (const mesh of data.meshes) {
      if (mesh.splint !== state.splint) continue;
      const field = wanted ? mesh.fields.find((f) => f.procedure === wanted) : null;
      const on = state.hidden[mesh.layer] === undefined ? (field ? true : wanted === null && mesh.planned)
                                                        : !state.hidden[mesh.layer];
      if (on) layers.push([mesh, field || null]);
    }
    return layers;
  }
  function poseOf(mesh, field) {
    return field ? field.pose : mesh.pose || identity;
  }

  // The shown surfaces just fill the canvas as it is turned now.
  function fit() {
    const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    for (const [mesh, field] of shownLayers()) {
      upload(mesh);
      const pose = poseOf(mesh, field), p = mesh.cpu.positions;
      for (let i = 0; i < p.length; i += 9) {  // every third vertex will do
        const s = [0, 1, 2].map((r) => pose[4 * r] * p[i] + pose[4 * r + 1] * p[i + 1] +
                                       pose[4 * r + 2] * p[i + 2] + pose[4 * r + 3]);
        for (let r = 0; r < 3; ++r) {
          const x = state.turn[r][0] * s[0] + state.turn[r][1] * s[1] + state.turn[r][2] * s[2];
          low[r] = Math.min(low[r], x);
          high[r] = Math.max(high[r], x);
        }
      }
    }
    if (low[0] > high[0]) return;
    const middle = [0, 1, 2].map((r) => (low[r] + high[r]) / 2), aspect = canvas.clientWidth / canvas.clientHeight;
    state.centre = [0, 1, 2].map((k) => state.turn.reduce((sum, axis, r) => sum + axis[k] * middle[r], 0));
    const across = (high[0] - low[0]) / 2, up = (high[1] - low[1]) / 2;
    state.half = 1.12 * Math.max(0.5, aspect > 1 ? Math.max(up, across / aspect) : Math.max(across, up * aspect));
  }

  function eyeMatrix() {
    const m = identity.slice();
    for (let r = 0; r < 3; ++r) {
      let shift = 0;
      for (let c = 0; c < 3; ++c) {
        m[4 * r + c] = state.turn[r][c];
        shift -= state.turn[r][c] * state.centre[c];
      }
      m[4 * r + 3] = shift;
    }
    return m;
  }
  function clipScale() {
    const aspect = canvas.width / canvas.height, s = 1 / state.half;
    return aspect > 1 ? [s / aspect, s, -1 / 400] : [s, s * aspect, -1 / 400];
  }

  function drawLayer(mesh, field) {
    const gpu = upload(mesh);
    const feed = (buffer, location, size) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, gl.FLOAT, false, 0, 0);
    };
    feed(gpu.positions, at.position, 3);
    feed(gpu.normals, at.normal, 3);
    if (field) {
      feed(fieldBuffer(mesh, field), at.value, 2);
    } else {
      gl.disableVertexAttribArray(at.value);
      gl.vertexAttrib2f(at.value, 0, 1);
    }
    gl.uniform1i(set.coloured, field ? 1 : 0);
    gl.uniformMatrix4fv(set.sceneFromMesh, false, columns(poseOf(mesh, field)));
    const alpha = field || chosenProcedure() === null && mesh.layer !== 'planned splint' ? 1 : mesh.opacity;
    gl.uniform4f(set.color, mesh.color[0], mesh.color[1], mesh.color[2], alpha);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gpu.indices);
    if (alpha < 1) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
    }
    gl.drawElements(gl.TRIANGLES, gpu.count, mesh.wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT, 0);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    return {triangles: gpu.count / 3, solid: alpha === 1};
  }

  let queued = false;
  function redraw() {
    if (queued) return;
    queued = true;
    requestAnimationFrame(() => { queued = false; draw(); });
  }

  function draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.uniformMatrix4fv(set.eyeFromScene, false, columns(eyeMatrix()));
    gl.uniform3fv(set.clipScale, clipScale());
    gl.uniform1f(set.rangeMicrometres, 1000 * state.range);
    gl.uniform3fv(set.notMeasured, data.not_measured);
    gl.uniform1i(set.colourMap, 0);
    const layers = shownLayers();
    // See-through layers last, so that what is behind them is there.
    const see = ([mesh, field]) => !field && mesh.opacity < 1;
    let triangles = 0;
    for (const [mesh, field] of layers.filter((l) => !see(l)).concat(layers.filter(see)))
      triangles += drawLayer(mesh, field).triangles;
    const error = gl.getError();
    report(layers.length, triangles, error);
    drawScaleBar();
  }

  // Once, after the first frame: how much of the picture is covered, read back from the frame itself.
  let coverage = null;
  function report(layers, triangles, error) {
    if (coverage === null) {
      const pixels = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      let covered = 0;
      for (let i = 0; i < pixels.length; i += 4)
        covered += pixels[i] < 250 || pixels[i + 1] < 250 || pixels[i + 2] < 250;
      coverage = 4 * covered / pixels.length;
      status.dataset.coverage = coverage.toFixed(4);
    }
    status.dataset.error = error;
    status.dataset.drawn = 'yes';
    status.textContent = layers + (layers === 1 ? ' layer, ' : ' layers, ') + triangles +
                         ' triangles (simplified for viewing; the figures come from the full scans)';
  }

  function drawScaleBar() {
    const bar = byId('view-scale'), aspect = canvas.clientWidth / canvas.clientHeight;
    const pxPerMm = (aspect > 1 ? canvas.clientHeight : canvas.clientWidth) / (2 * state.half);
    let length = 0.1;
    for (const next of [0.2, 0.5, 1, 2, 5, 10, 20, 50]) if (next * pxPerMm < 140) length = next;
    bar.style.width = (length * pxPerMm).toFixed(1) + 'px';
    bar.textContent = length + ' mm';
  }

  // ---- turning, moving, reading -----------------------------------------------------------------------------

  function turnBy(dx, dy) {  // radians about the eye's up and right axes
    const about = (i, j, angle) => {
      const c = Math.cos(angle), s = Math.sin(angle), a = state.turn[i].slice(), b = state.turn[j].slice();
      for (let k = 0; k < 3; ++k) {
        state.turn[i][k] = c * a[k] - s * b[k];
        state.turn[j][k] = s * a[k] + c * b[k];
      }
    };
    about(2, 0, dx);
    about(1, 2, dy);
    redraw();
  }
  function moveBy(dxPx, dyPx) {
    const mm = 2 * state.half / Math.min(canvas.clientWidth, canvas.clientHeight);
    for (let k = 0; k < 3; ++k) state.centre[k] += mm * (-dxPx * state.turn[0][k] + dyPx * state.turn[1][k]);
    redraw();
  }
  function zoomBy(factor) {
    state.half = Math.min(300, Math.max(0.3, state.half * factor));
    redraw();
  }
  function look(name) {
    state.turn = views[name].map((axis) => axis.slice());
    redraw();
  }

  // The distance under a click, from the same triangles that are drawn.
  function readAt(clientX, clientY) {
    const box = canvas.getBoundingClientRect(), scale = clipScale(), eye = eyeMatrix();
    const x = (2 * (clientX - box.left) / box.width - 1) / scale[0];
    const y = (1 - 2 * (clientY - box.top) / box.height) / scale[1];
    let best = null;
    for (const [mesh, field] of shownLayers()) {
      if (!field) continue;
      const pose = poseOf(mesh, field), p = mesh.cpu.positions, index = mesh.cpu.indices, n = p.length / 3;
      const e = new Float32Array(p.length);
      for (let i = 0; i < n; ++i) {
        const s = [0, 1, 2].map((r) => pose[4 * r] * p[3 * i] + pose[4 * r + 1] * p[3 * i + 1] +
                                       pose[4 * r + 2] * p[3 * i + 2] + pose[4 * r + 3]);
        for (let r = 0; r < 3; ++r)
          e[3 * i + r] = eye[4 * r] * s[0] + eye[4 * r + 1] * s[1] + eye[4 * r + 2] * s[2] + eye[4 * r + 3];
      }
      for (let t = 0; t < index.length; t += 3) {
        const [a, b, c] = [index[t], index[t + 1], index[t + 2]];
        const area = (e[3 * b] - e[3 * a]) * (e[3 * c + 1] - e[3 * a + 1]) -
                     (e[3 * c] - e[3 * a]) * (e[3 * b + 1] - e[3 * a + 1]);
        if (!area) continue;
        const v = ((x - e[3 * a]) * (e[3 * c + 1] - e[3 * a + 1]) -
                   (e[3 * c] - e[3 * a]) * (y - e[3 * a + 1])) / area;
        const w = ((e[3 * b] - e[3 * a]) * (y - e[3 * a + 1]) - (x - e[3 * a]) * (e[3 * b + 1] - e[3 * a + 1])) / area;
        if (v < 0 || w < 0 || v + w > 1) continue;
        const depth = (1 - v - w) * e[3 * a + 2] + v * e[3 * b + 2] + w * e[3 * c + 2];
        if (best && best.depth >= depth) continue;
        const f = field.cpu, known = [a, b, c].every((i) => f[i] !== NOT_MEASURED);
        best = {depth, mm: known ? ((1 - v - w) * f[a] + v * f[b] + w * f[c]) / 1000 : null};
      }
    }
    byId('view-reading').textContent = !best ? '' : best.mm === null ? 'not measured here'
        : (best.mm > 0 ? '+' : '') + best.mm.toFixed(3).replace('-', '−') + ' mm here';
  }

  const fingers = new Map();
  let pressed = null;
  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    pressed = [event.clientX, event.clientY];
  });
  canvas.addEventListener('pointermove', (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const gap = (p) => Math.max(10, Math.hypot(p[0] - other[0], p[1] - other[1]));
      zoomBy(gap(before) / gap(now));
      moveBy(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      moveBy(dx, dy);
    } else {
      turnBy(dx * 0.008, dy * 0.008);
    }
    fingers.set(event.pointerId, now);
  });
  const lift = (event) => {
    if (fingers.delete(event.pointerId) && event.type === 'pointerup' && pressed &&
        Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4)
      readAt(event.clientX, event.clientY);
  };
  canvas.addEventListener('pointerup', lift);
  canvas.addEventListener('pointercancel', lift);
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    zoomBy(Math.exp(Math.max(-100, Math.min(100, event.deltaY)) * 0.0025));
  }, {passive: false});
  canvas.addEventListener('keydown', (event) => {
    const step = 0.1, keys = {
      ArrowLeft: () => turnBy(-step, 0), ArrowRight: () => turnBy(step, 0),
      ArrowUp: () => turnBy(0, -step), ArrowDown: () => turnBy(0, step),
      '+': () => zoomBy(0.9), '-': () => zoomBy(1.1),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  window.addEventListener('resize', redraw);

  // ---- controls ---------------------------------------------------------------------------------------------

  function option(select, value, text) {
    const o = document.createElement('option');
    o.value = value;
    o.textContent = text;
    select.appendChild(o);
  }
  function fillLayers() {
    const box = byId('view-layers'), shown = shownLayers().map(([mesh]) => mesh.layer);
    box.textContent = '';
    for (const mesh of data.meshes.filter((m) => m.splint === state.splint)) {
      const label = document.createElement('label'), tick = document.createElement('input');
      tick.type = 'checkbox';
      tick.checked = shown.includes(mesh.layer);
      tick.addEventListener('change', () => { state.hidden[mesh.layer] = !tick.checked; redraw(); });
      const swatch = document.createElement('span');
      swatch.className = 'swatch';
      swatch.style.background = 'rgb(' + mesh.color.map((c) => Math.round(255 * c)).join(',') + ')';
      label.append(tick, swatch, mesh.layer);
      box.appendChild(label);
    }
  }
  function showLegend() {
    byId('view-legend').style.visibility = chosenProcedure() ? 'visible' : 'hidden';
    byId('view-low').textContent = '−' + state.range.toFixed(2);
    byId('view-high').textContent = '+' + state.range.toFixed(2) + ' mm';
    const p = data.procedures[state.procedure];
    const facts = p && p.facts[state.splint];
    byId('view-facts').textContent = facts || (p ? 'not measured for this splint' : 'as planned, without distances');
  }
  function choose() {
    state.hidden = {};
    byId('view-reading').textContent = '';
    fillLayers();
    showLegend();
    redraw();
  }
  const splints = byId('view-splint'), procedures = byId('view-procedure'), range = byId('view-range');
  data.splints.forEach((name, i) => option(splints, i, name));
  option(procedures, -1, 'the plan, no distances');
  data.procedures.forEach((p, i) => option(procedures, i, p.title));
  procedures.value = state.procedure;
  splints.addEventListener('change', () => { state.splint = Number(splints.value); choose(); });
  procedures.addEventListener('change', () => { state.procedure = Number(procedures.value); choose(); fit(); });
  range.value = state.range;
  range.addEventListener('input', () => { state.range = Number(range.value); showLegend(); redraw(); });
  for (const name of Object.keys(views)) {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = name;
    button.addEventListener('click', () => { look(name); fit(); });
    byId('view-buttons').appendChild(button);
  }
  let map = 'linear-gradient(to right';
  for (let i = 0; i < 256; i += 15) map += ',#' + data.colour_map.substr(6 * i, 6);
  byId('view-bar').style.background = map + ')';

  state.turn = Object.values(views)[0].map((axis) => axis.slice());
  // With #check behind the address every choice is drawn once and the picture is read at many places: what the
  // report's test asks for, and a quick look at whether a browser copes.
  function check() {
    let frames = 0, errors = 0, readings = 0;
    for (let s = 0; s < data.splints.length; ++s)
      for (let p = -1; p < data.procedures.length; ++p) {
        [state.splint, state.procedure] = [s, p];
        choose();
        for (const name of Object.keys(views)) {
          look(name);
          fit();
          draw();
          ++frames;
          errors += status.dataset.error !== '0';
        }
      }
    [state.splint, state.procedure] = [0, 0];
    choose();
    turnBy(0.2, 0.1);
    moveBy(3, 2);
    zoomBy(0.9);
    draw();
    const box = canvas.getBoundingClientRect();
    for (let i = 1; i < 12; ++i)
      for (let j = 1; j < 12; ++j) {
        readAt(box.left + box.width * i / 12, box.top + box.height * j / 12);
        const text = byId('view-reading').textContent;
        if (text.includes('mm')) {
          ++readings;
          status.dataset.reading = parseFloat(text.replace('−', '-'));
        }
      }
    Object.assign(status.dataset, {frames, errors, readings});
  }

  try {
    choose();
    fit();
    draw();
    if (location.hash === '#check') check();
  } catch (problem) {
    status.textContent = 'the 3D view does not work here (' + problem.message + '): see the pictures below';
  }
})();

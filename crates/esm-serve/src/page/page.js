// The map, the robot's path and its current cloud, from above and in 3-D. No library: points and lines in WebGL.
'use strict';

const $ = (id) => document.getElementById(id);
const VERDICTS = { located: [0.07, 0.45, 0.29], ambiguous: [0.6, 0.4, 0], not_found: [0.65, 0.16, 0.1] };
const STAGES = ['accumulation', 'segmentation', 'preprocessing', 'descriptor', 'matching', 'pose', 'verification'];
const STAGE_COLOURS = ['#8fa3b5', '#4c78a8', '#9ecae9', '#f58518', '#ffbf79', '#54a24b', '#88d27a'];
const MAX_PATH = 20000;
const MAX_HISTORY = 80;

// ---------------------------------------------------------------- talking to the service

let token = sessionStorage.getItem('token') || '';

async function ask(path, again = true) {
  const headers = token ? { authorization: `Bearer ${token}` } : {};
  const reply = await fetch(path, { headers });
  if (reply.status === 401 && again) {
    const given = prompt('The service wants its token:');
    if (given) {
      token = given.trim();
      sessionStorage.setItem('token', token);
      return ask(path);
    }
  }
  if (!reply.ok) {
    const problem = await reply.json().catch(() => ({}));
    throw new Error(problem.detail || `${path}: ${reply.status}`);
  }
  return reply;
}

// ---------------------------------------------------------------- drawing

const canvas = $('scene');
const gl = canvas.getContext('webgl', { antialias: true, preserveDrawingBuffer: true });

const VERTEX = `
attribute vec3 at; attribute vec3 colour; uniform mat4 view; uniform float size; varying vec3 c;
void main() { gl_Position = view * vec4(at, 1.0); gl_PointSize = size; c = colour; }`;
const FRAGMENT = 'precision mediump float; varying vec3 c; void main() { gl_FragColor = vec4(c, 1.0); }';

function program() {
  const p = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const s = gl.createShader(kind);
    gl.shaderSource(s, text);
    gl.compileShader(s);
    gl.attachShader(p, s);
  }
  gl.bindAttribLocation(p, 0, 'at');
  gl.bindAttribLocation(p, 1, 'colour');
  gl.linkProgram(p);
  gl.useProgram(p);
  return { view: gl.getUniformLocation(p, 'view'), size: gl.getUniformLocation(p, 'size') };
}

const uniform = gl ? program() : null;

// Vertices of six numbers: x y z r g b.
function layer(mode, size) {
  const buffer = gl.createBuffer();
  let n = 0;
  return {
    set(data) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      n = data.length / 6;
    },
    count: () => n,
    draw() {
      if (!n) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(0);
      gl.enableVertexAttribArray(1);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 24, 0);
      gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 24, 12);
      gl.uniform1f(uniform.size, size * devicePixelRatio);
      gl.drawArrays(mode, 0, n);
    },
  };
}

const layers = gl && {
  map: layer(gl.POINTS, 1.6),
  cloud: layer(gl.POINTS, 2.4),
  matches: layer(gl.LINES, 1),
  path: layer(gl.POINTS, 4),
  robot: layer(gl.TRIANGLES, 1),
};

// Metres around a target; pitch 90 degrees looks straight down.
const camera = { target: [0, 0, 0], distance: 120, yaw: 0, pitch: Math.PI / 2 };

function viewMatrix() {
  const { target: t, distance: d, yaw, pitch } = camera;
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const right = [cy, sy, 0];
  const back = [sy * cp, -cy * cp, sp];
  const up = [-sy * sp, cy * sp, cp];
  const eye = t.map((v, i) => v + d * back[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const f = 1 / Math.tan(0.4);
  const aspect = canvas.width / canvas.height;
  const [near, far] = [d * 0.02, d * 20 + 500];
  const a = (far + near) / (near - far);
  const b = (2 * far * near) / (near - far);
  // Projection times view, column by column.
  const m = [];
  for (let i = 0; i < 3; i++) m.push((f / aspect) * right[i], f * up[i], a * back[i], -back[i]);
  m.push((-f / aspect) * dot(right, eye), -f * dot(up, eye), -a * dot(back, eye) + b, dot(back, eye));
  return new Float32Array(m);
}

let dirty = true;
function frame() {
  requestAnimationFrame(frame);
  const [w, h] = [Math.round(innerWidth * devicePixelRatio), Math.round(innerHeight * devicePixelRatio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
    dirty = true;
  }
  if (!dirty) return;
  dirty = false;
  gl.viewport(0, 0, w, h);
  gl.clearColor(0.957, 0.965, 0.973, 1);
  gl.enable(gl.DEPTH_TEST);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.uniformMatrix4fv(uniform.view, false, viewMatrix());
  layers.map.draw();
  // What is live lies over the map from above too.
  gl.disable(gl.DEPTH_TEST);
  for (const name of ['cloud', 'matches', 'path', 'robot']) layers[name].draw();
}

// ---------------------------------------------------------------- the map

let maps = [];
let shown = null;
let origin = [0, 0, 0];

function hue(n) {
  const h = ((n * 0.61803398875) % 1) * 6;
  const ramp = (k) => Math.min(1, Math.max(0, Math.abs(((h + k) % 6) - 3) - 1));
  return [0, 4, 2].map((k) => 0.25 + 0.5 * ramp(k));
}

// The same thing is cut once in every window of the map that saw it: what stands at one place has one colour.
function colours(points) {
  const sums = new Map();
  for (let i = 0; i < points.length; i += 4) {
    const kind = points[i + 3];
    const sum = sums.get(kind) || [0, 0, 0];
    sum[0] += points[i];
    sum[1] += points[i + 1];
    sum[2] += 1;
    sums.set(kind, sum);
  }
  const places = new Map();
  const colour = new Map([[0, [0.78, 0.8, 0.82]]]);
  for (const [kind, [x, y, n]] of sums) {
    if (kind === 0) continue;
    const [cx, cy] = [Math.round(x / n / 2), Math.round(y / n / 2)];
    let place = null;
    for (const [dx, dy] of [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]]) {
      place = place ?? places.get(`${cx + dx},${cy + dy}`) ?? null;
    }
    place = place ?? places.size + 1;
    places.set(`${cx},${cy}`, place);
    colour.set(kind, hue(place));
  }
  return colour;
}

async function show(name) {
  $('note').textContent = `loading ${name}`;
  const reply = await ask(`/v1/maps/${encodeURIComponent(name)}/points`);
  origin = JSON.parse(reply.headers.get('x-esm-origin'));
  const points = new Float32Array(await reply.arrayBuffer());
  const n = points.length / 4;
  const colour = colours(points);
  const vertices = new Float32Array(n * 6);
  const box = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = 0; i < n; i++) {
    const [x, y, z, kind] = points.subarray(4 * i, 4 * i + 4);
    vertices.set([x, y, z, ...colour.get(kind)], 6 * i);
    [x, y, z].forEach((v, a) => {
      box[0][a] = Math.min(box[0][a], v);
      box[1][a] = Math.max(box[1][a], v);
    });
  }
  shown = name;
  layers.map.set(vertices);
  if (n) {
    camera.target = [0, 1, 2].map((a) => (box[0][a] + box[1][a]) / 2);
    const [w, h] = [box[1][0] - box[0][0], box[1][1] - box[0][1]];
    camera.distance = 1.35 * Math.max(w / (innerWidth / innerHeight), h, 20);
  }
  clear();
  const map = maps.find((m) => m.name === name);
  $('note').textContent = `${map ? map.segments : '?'} segments, ${n} points shown`;
  dirty = true;
}

// ---------------------------------------------------------------- the robot

let path = [];
let history = [];
let answers = 0;

function clear() {
  path = [];
  for (const name of ['cloud', 'matches', 'path', 'robot']) layers[name].set(new Float32Array());
  dirty = true;
}

function rotate([qx, qy, qz, qw], [x, y, z]) {
  const [tx, ty, tz] = [2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)];
  return [
    x + qw * tx + qy * tz - qz * ty,
    y + qw * ty + qz * tx - qx * tz,
    z + qw * tz + qx * ty - qy * tx,
  ];
}

function text(event) {
  const verdict = $('verdict');
  verdict.textContent = event.verdict.replace('_', ' ');
  verdict.className = event.verdict;
  $('reason').textContent = event.reason || '';
  const pose = event.pose;
  $('position').textContent = pose ? pose.t.map((v) => v.toFixed(2)).join(', ') + ' m' : '–';
  $('score').textContent = `${event.score.toFixed(1)}, ${event.runner_up.toFixed(1)}`;
  $('segments').textContent = `${event.segments}, ${event.inliers}`;
  $('travel').textContent = `${event.travel_m.toFixed(1)} m`;
  const total = event.timings_ms.total;
  $('time').textContent = `${total.toFixed(1)} ms (${answers} answers)`;
  $('stages').replaceChildren(
    ...STAGES.map((stage, i) => {
      const part = document.createElement('div');
      part.style.width = `${(100 * event.timings_ms[stage]) / Math.max(total, 1e-9)}%`;
      part.style.background = STAGE_COLOURS[i];
      part.title = `${stage} ${event.timings_ms[stage].toFixed(1)} ms`;
      return part;
    })
  );
  history.push(event);
  history = history.slice(-MAX_HISTORY);
  const most = Math.max(...history.map((h) => h.score), 1);
  $('history').replaceChildren(
    ...history.map((h) => {
      const bar = document.createElement('div');
      bar.style.flex = '1';
      bar.style.height = `${15 + (85 * h.score) / most}%`;
      bar.style.background = `rgb(${VERDICTS[h.verdict].map((v) => 255 * v).join(',')})`;
      return bar;
    })
  );
}

function draw(event) {
  const at = event.pose.t.map((v, a) => v - origin[a]);
  const q = event.pose.q;
  const colour = VERDICTS[event.verdict];
  const place = (p) => rotate(q, p).map((v, a) => v + at[a]);
  layers.cloud.set(new Float32Array(event.cloud_cm.flatMap((p) => [...place(p.map((v) => v / 100)), 0.85, 0.33, 0.1])));
  const local = event.matches.map((m) => m.map((v, a) => v - origin[a]));
  layers.matches.set(new Float32Array(local.flatMap((m) => [...at, 0.2, 0.45, 0.75, ...m, 0.2, 0.45, 0.75])));
  path.push([...at, ...colour]);
  path = path.slice(-MAX_PATH);
  layers.path.set(new Float32Array(path.flat()));
  const size = 2.2;
  const arrow = [[1, 0, 0], [-0.7, 0.6, 0], [-0.7, -0.6, 0]].map((p) => place(p.map((v) => v * size)));
  layers.robot.set(new Float32Array(arrow.flatMap((p) => [...p, 0.05, 0.1, 0.2])));
  if ($('follow').checked) camera.target = at;
}

function take(event) {
  answers += 1;
  text(event);
  if (gl && event.map === shown && event.pose) draw(event);
  dirty = true;
}

async function watch() {
  for (;;) {
    try {
      const reply = await ask('/v1/events', false);
      const reader = reply.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = '';
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        rest += value;
        const parts = rest.split('\n\n');
        rest = parts.pop();
        const events = parts.filter((p) => p.startsWith('data: ')).map((p) => JSON.parse(p.slice(6)));
        events.forEach(take);
      }
    } catch (error) {
      $('note').textContent = String(error.message || error);
    }
    await new Promise((r) => setTimeout(r, 1000));
  }
}

// ---------------------------------------------------------------- hands

function pan(dx, dy) {
  const k = (2 * Math.tan(0.4) * camera.distance) / innerHeight;
  const [c, s] = [Math.cos(camera.yaw), Math.sin(camera.yaw)];
  camera.target[0] += -k * dx * c - k * dy * s;
  camera.target[1] += -k * dx * s + k * dy * c;
}

function hands() {
  const touching = new Map();
  let pinch = 0;
  canvas.addEventListener('pointerdown', (e) => {
    canvas.setPointerCapture(e.pointerId);
    touching.set(e.pointerId, e);
  });
  const up = (e) => {
    touching.delete(e.pointerId);
    pinch = 0;
  };
  canvas.addEventListener('pointerup', up);
  canvas.addEventListener('pointercancel', up);
  canvas.addEventListener('pointermove', (e) => {
    const before = touching.get(e.pointerId);
    if (!before) return;
    const [dx, dy] = [e.clientX - before.clientX, e.clientY - before.clientY];
    touching.set(e.pointerId, e);
    if (touching.size === 2) {
      const [a, b] = [...touching.values()];
      const apart = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (pinch) camera.distance *= pinch / apart;
      pinch = apart;
    } else if (e.shiftKey || e.buttons === 2 || camera.pitch < 1.5) {
      camera.yaw -= dx * 0.006;
      camera.pitch = Math.min(Math.PI / 2, Math.max(0.1, camera.pitch + dy * 0.006));
    } else {
      pan(dx, dy);
      $('follow').checked = false;
    }
    dirty = true;
  });
  canvas.addEventListener('wheel', (e) => {
    camera.distance = Math.min(5000, Math.max(3, camera.distance * Math.exp(e.deltaY * 0.001)));
    dirty = true;
    e.preventDefault();
  }, { passive: false });
  canvas.addEventListener('contextmenu', (e) => e.preventDefault());
  $('view').addEventListener('click', () => {
    const above = camera.pitch > 1.5;
    camera.pitch = above ? 0.6 : Math.PI / 2;
    if (!above) camera.yaw = 0;
    $('view').textContent = above ? 'From above' : '3-D';
    dirty = true;
  });
  $('clear').addEventListener('click', clear);
  $('map').addEventListener('change', () => show($('map').value).catch((e) => { $('note').textContent = e.message; }));
}

async function start() {
  $('legend').replaceChildren(
    ...STAGES.map((stage, i) => {
      const item = document.createElement('span');
      const mark = document.createElement('i');
      mark.style.background = STAGE_COLOURS[i];
      item.append(mark, stage);
      return item;
    })
  );
  if (!gl) {
    $('note').textContent = 'this browser has no WebGL: there are words, but no picture';
  } else {
    hands();
    requestAnimationFrame(frame);
  }
  maps = (await (await ask('/v1/maps')).json()).maps;
  $('map').replaceChildren(...maps.map((m) => new Option(m.name, m.name)));
  const wanted = new URLSearchParams(location.search);
  if (wanted.get('view') === '3d') $('view').click();
  if (gl && maps.length) await show(wanted.get('map') || maps[0].name);
  await watch();
}

start().catch((error) => { $('note').textContent = String(error.message || error); });

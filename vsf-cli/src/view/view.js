// Draws points and triangles with a depth buffer of its own, so that no graphics card is needed.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id);

// ---- Data -------------------------------------------------------------------------------------

function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}
const floats = text => new Float32Array(bytes(text).buffer);
const counts = text => new Uint32Array(bytes(text).buffer);

const cloud = data.cloud, motion = data.motion;
const points = floats(cloud.points), n = points.length / 3;
const touched = cloud.touched === null ? null : bytes(cloud.touched);
const layers = cloud.layers.map(l => ({ ...l, values: floats(l.values) }));
const parents = motion ? motion.robot.parents : [];
const links = parents.length;
const surfaces = motion ? motion.robot.surfaces.map(s =>
  ({ link: s.link, vertices: floats(s.vertices), faces: counts(s.faces) })) : [];
const tracks = motion ? motion.sequences.map(s => ({
  id: s.id, time: floats(s.time), poses: floats(s.poses), counts: counts(s.counts),
  starts: counts(s.starts), points: counts(s.points), shifts: floats(s.shifts), loads: floats(s.loads),
})) : [];
const canTouch = tracks.some(t => t.counts.length > 0) && cloud.total > 0;

/** Four significant digits. */
function number(v) {
  if (v === 0) return "0";
  const size = Math.abs(v);
  if (size < 1e-3 || size >= 1e6) return v.toExponential(2);
  return v.toFixed(Math.min(6, Math.max(0, 3 - Math.floor(Math.log10(size)))));
}

// ---- State ------------------------------------------------------------------------------------

let layer = 0, track = 0, sample = 0, playing = false;

/** The box around those positions, `stride` numbers apart, that `take` wants: corners, middle, radius. */
function boxOf(arrays, stride, take) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const a of arrays) for (let i = 0; i < a.length; i += stride) {
    if (!take(i / stride)) continue;
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], a[i + k]);
      high[k] = Math.max(high[k], a[i + k]);
    }
  }
  if (low[0] > high[0]) return null;
  const middle = low.map((v, k) => (v + high[k]) / 2);
  const radius = Math.hypot(...low.map((v, k) => high[k] - v)) / 2;
  return { low, high, middle, radius: Math.max(radius, cloud.spacing, 1e-3) };
}

/** What there is: the points, or else the robot, wherever its links come. */
const reached = boxOf(tracks.map(t => t.poses), 7, () => true);
const bounds = boxOf([points], 3, () => true) || reached ||
  { low: [0, 0, 0], high: [0, 0, 0], middle: [0, 0, 0], radius: 0.5 };

/** The points that were touched; all where that is not known. */
const focus = touched !== null && boxOf([points], 3, i => touched[i] === 1) || bounds;
/** Points and robot, where it touches none of them: it may be anywhere. */
const missed = reached && n > 0 && tracks.every(t => t.counts.every(c => c === 0));
const apart = missed ? boxOf([[bounds, reached].flatMap(b => [...b.low, ...b.high])], 3, () => true) : null;
/** The view of what is shown; of untouched points, of some around those that were touched. */
function start() {
  const shown = boxOf([points], 3, i => colors[i] !== EMPTY) || bounds;
  const { middle, radius } = apart || { ...focus, radius: Math.min(shown.radius, 2 * focus.radius) };
  return { azimuth: -60, elevation: 25, distance: 3.1 * radius, target: [...middle] };
}
let camera;

// ---- Colors ----------------------------------------------------------------------------------

const PAPER = [255, 255, 255], GRAY = [182, 190, 199], NOW = [0, 114, 178], LINK = [120, 132, 146];
const FOG = 16, EMPTY = 255, NEVER = data.palette.length;
const packed = c => (255 << 24 | c[2] << 16 | c[1] << 8 | c[0]) >>> 0;
const mix = (a, b, f) => a.map((v, k) => Math.round(v + f * (b[k] - v)));
/** Colors of the palette and of untouched points, paler with distance; the rim is darker. */
const shades = [0, 0.25].map(dark => Array.from({ length: FOG }, (_, f) => Uint32Array.from(
  [...data.palette, GRAY], c => packed(mix(mix(c, [0, 0, 0], dark), PAPER, 0.4 * f / (FOG - 1))))));

/** The color of each point: a number in the palette, NEVER for untouched ones, EMPTY for hidden. */
const colors = new Uint8Array(n);
function paint() {
  const shown = layers[layer], last = data.palette.length - 1;
  const least = shown ? shown.limit * $("least").value / 100 : 0;
  const rest = $("untouched").value;
  for (let i = 0; i < n; i++) {
    const own = touched === null || touched[i] === 1 || rest === "colored";
    if (!shown) colors[i] = NEVER;
    else if (!own) colors[i] = rest === "hidden" || least > 0 ? EMPTY : NEVER;
    else if (shown.values[i] < least) colors[i] = EMPTY;
    else colors[i] = Math.min(last, Math.round(last * shown.values[i] / shown.limit));
  }
}

// ---- Drawing ----------------------------------------------------------------------------------

const stage = $("stage"), context = stage.getContext("2d");
let W = 0, H = 0, image, pixels, depth, who, linkDepth, linkShade;

function resize(coarse) {
  const box = stage.getBoundingClientRect();
  let scale = Math.min(window.devicePixelRatio || 1, 2);
  scale = Math.min(scale, Math.sqrt(2.5e6 / Math.max(1, box.width * box.height))) * (coarse ? 0.5 : 1);
  const w = Math.max(1, Math.round(box.width * scale)), h = Math.max(1, Math.round(box.height * scale));
  if (w === W && h === H) return;
  [W, H] = [w, h];
  [stage.width, stage.height] = [W, H];
  image = context.createImageData(W, H);
  pixels = new Uint32Array(image.data.buffer);
  depth = new Float32Array(W * H);
  who = new Int32Array(W * H);
  linkDepth = new Float32Array(W * H);
  linkShade = new Uint8Array(W * H);
}

/** The rows of the camera's axes (right, down, forward), its place, and the focal length. */
function lens() {
  const a = camera.azimuth * Math.PI / 180, e = camera.elevation * Math.PI / 180;
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  const forward = [-ce * ca, -ce * sa, -se], right = [-sa, ca, 0];
  const down = [ca * se, sa * se, -ce];
  const eye = camera.target.map((v, k) => v - camera.distance * forward[k]);
  return { right, down, forward, eye, focal: 1.35 * Math.min(W, H), near: 0.02 * camera.distance };
}

/** Where a point is on the screen: x, y, and its distance along the line of sight. */
function project(l, x, y, z) {
  const a = x - l.eye[0], b = y - l.eye[1], c = z - l.eye[2];
  const away = a * l.forward[0] + b * l.forward[1] + c * l.forward[2];
  const f = l.focal / away;
  return [W / 2 + f * (a * l.right[0] + b * l.right[1] + c * l.right[2]),
    H / 2 + f * (a * l.down[0] + b * l.down[1] + c * l.down[2]), away];
}

/** A disc that is nearer than what is there; `id` is found again under the pointer. */
function disc(x, y, away, r, fill, rim, id) {
  const rimmed = rim !== fill;
  const top = Math.max(0, Math.ceil(y - r)), bottom = Math.min(H - 1, Math.floor(y + r));
  for (let row = top; row <= bottom; row++) {
    const half = Math.sqrt(r * r - (row - y) * (row - y));
    const from = Math.max(0, Math.ceil(x - half)), to = Math.min(W - 1, Math.floor(x + half));
    const edge = rimmed && Math.abs(row - y) > r - 1;
    for (let k = row * W + from, column = from; column <= to; column++, k++) {
      if (away >= depth[k]) continue;
      depth[k] = away;
      who[k] = id;
      pixels[k] = edge || rimmed && Math.abs(column - x) > half - 1 ? rim : fill;
    }
  }
}

function drawCloud(l, moved) {
  const size = 0.5 * Math.max(cloud.spacing, 1e-3 * bounds.radius), least = 0.75 * W / stage.clientWidth;
  const first = project(l, ...bounds.middle)[2] - bounds.radius, range = FOG / (2 * bounds.radius);
  const rims = shades[size * l.focal / camera.distance > 2 ? 1 : 0];
  for (let i = 0; i < n; i++) {
    if (colors[i] === EMPTY || moved !== null && moved.has(i)) continue;
    const [x, y, away] = project(l, points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    if (away < l.near) continue;
    const small = colors[i] === NEVER && layers.length > 0 ? 0.6 : 1;
    const r = Math.min(60, Math.max(least, small * size * l.focal / away));
    if (x < -r || y < -r || x > W + r || y > H + r) continue;
    const fog = Math.min(FOG - 1, Math.max(0, Math.floor((away - first) * range)));
    disc(x, y, away, r, shades[0][fog][colors[i]], rims[fog][colors[i]], i);
  }
}

/** Touched points at their displaced places, over everything. */
function drawTouches(l, moved) {
  const size = 0.45 * Math.max(cloud.spacing, 1e-3 * bounds.radius), least = 1.2 * W / stage.clientWidth;
  const fill = packed(NOW), rim = packed(mix(NOW, PAPER, 0.6));
  for (const [i, k] of moved) {
    const u = tracks[track].shifts, p = 3 * i, q = 3 * k;
    const [x, y, away] = project(l, points[p] + u[q], points[p + 1] + u[q + 1], points[p + 2] + u[q + 2]);
    // Nearer than all else, and in order among themselves.
    if (away >= l.near) disc(x, y, away * 1e-6, Math.max(least, size * l.focal / away), fill, rim, i);
  }
}

/** Turns a vertex of a link into the world. */
function place(poses, at, x, y, z) {
  const [a, b, c, w] = [poses[at + 3], poses[at + 4], poses[at + 5], poses[at + 6]];
  const tx = 2 * (b * z - c * y), ty = 2 * (c * x - a * z), tz = 2 * (a * y - b * x);
  return [poses[at] + x + w * tx + b * tz - c * ty, poses[at + 1] + y + w * ty + c * tx - a * tz,
    poses[at + 2] + z + w * tz + a * ty - b * tx];
}

function drawRobot(l, poses, first) {
  linkDepth.fill(Infinity);
  for (const s of surfaces) {
    const m = s.vertices.length / 3, screen = new Float32Array(3 * m), world = new Float32Array(3 * m);
    for (let i = 0; i < m; i++) {
      const p = place(poses, first + 7 * s.link, s.vertices[3 * i], s.vertices[3 * i + 1], s.vertices[3 * i + 2]);
      world.set(p, 3 * i);
      screen.set(project(l, ...p), 3 * i);
    }
    for (let f = 0; f < s.faces.length; f += 3) triangle(l, screen, world, s.faces[f], s.faces[f + 1], s.faces[f + 2]);
  }
  const opacity = n > 0 ? 0.6 : 1;
  for (let k = 0; k < linkDepth.length; k++) {
    if (linkDepth[k] >= depth[k]) continue;
    const under = pixels[k], f = opacity, g = linkShade[k] / 255;
    let mixed = 255 << 24;
    for (let c = 0; c < 3; c++) {
      const v = (under >> 8 * c & 255) * (1 - f) + f * Math.min(255, LINK[c] * (0.4 + 0.9 * g));
      mixed |= Math.round(v) << 8 * c;
    }
    pixels[k] = mixed >>> 0;
  }
}

/** A triangle in the layer of the robot, brighter the more it looks at the camera. */
function triangle(l, s, w, i, j, k) {
  const [a, b, c] = [3 * i, 3 * j, 3 * k];
  if (s[a + 2] < l.near || s[b + 2] < l.near || s[c + 2] < l.near) return;
  const whole = (s[b] - s[a]) * (s[c + 1] - s[a + 1]) - (s[c] - s[a]) * (s[b + 1] - s[a + 1]);
  if (whole === 0) return;
  const left = Math.max(0, Math.ceil(Math.min(s[a], s[b], s[c])));
  const right = Math.min(W - 1, Math.floor(Math.max(s[a], s[b], s[c])));
  const top = Math.max(0, Math.ceil(Math.min(s[a + 1], s[b + 1], s[c + 1])));
  const bottom = Math.min(H - 1, Math.floor(Math.max(s[a + 1], s[b + 1], s[c + 1])));
  if (left > right || top > bottom) return;
  const p = [w[b] - w[a], w[b + 1] - w[a + 1], w[b + 2] - w[a + 2]];
  const q = [w[c] - w[a], w[c + 1] - w[a + 1], w[c + 2] - w[a + 2]];
  const m = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
  const facing = Math.abs(m[0] * l.forward[0] + m[1] * l.forward[1] + m[2] * l.forward[2]) / (Math.hypot(...m) || 1);
  for (let y = top; y <= bottom; y++) {
    for (let x = left; x <= right; x++) {
      const u = ((s[b] - x) * (s[c + 1] - y) - (s[c] - x) * (s[b + 1] - y)) / whole;
      const v = ((s[c] - x) * (s[a + 1] - y) - (s[a] - x) * (s[c + 1] - y)) / whole;
      if (u < 0 || v < 0 || u + v > 1) continue;
      const away = u * s[a + 2] + v * s[b + 2] + (1 - u - v) * s[c + 2], k = y * W + x;
      if (away >= linkDepth[k]) continue;
      linkDepth[k] = away;
      linkShade[k] = 255 * facing;
    }
  }
}

const AXES = [["x", "#c0392b"], ["y", "#2e8540"], ["z", "#1f5fa8"]];

function line(l, p, q, color, width) {
  const [a, b] = [project(l, ...p), project(l, ...q)];
  if (a[2] < l.near || b[2] < l.near) return b;
  context.strokeStyle = color;
  context.lineWidth = width * W / stage.clientWidth;
  context.beginPath();
  context.moveTo(a[0], a[1]);
  context.lineTo(b[0], b[1]);
  context.stroke();
  return b;
}

function drawFrames(l, poses, first) {
  const length = 0.12 * bounds.radius;
  for (let k = 0; k < links; k++) {
    const at = first + 7 * k, here = place(poses, at, 0, 0, 0);
    if (parents[k] >= 0) line(l, place(poses, first + 7 * parents[k], 0, 0, 0), here, "#1b2430", 1.5);
    AXES.forEach(([, color], a) => line(l, here, place(poses, at, ...[0, 1, 2].map(b => a === b ? length : 0)), color, 2));
  }
}

/** The axes of the world in the lower left corner. */
function drawAxes(l) {
  const unit = W / stage.clientWidth, [x, y] = [40 * unit, H - 40 * unit];
  context.font = `${12 * unit}px system-ui, sans-serif`;
  AXES.forEach(([name, color], a) => {
    const [dx, dy] = [28 * unit * l.right[a], 28 * unit * l.down[a]];
    context.strokeStyle = context.fillStyle = color;
    context.lineWidth = 2 * unit;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + dx, y + dy);
    context.stroke();
    context.fillText(name, x + 1.25 * dx - 3 * unit, y + 1.25 * dy + 4 * unit);
  });
}

function draw(coarse) {
  resize(coarse);
  const l = lens(), t = tracks[track];
  pixels.fill(packed(PAPER));
  depth.fill(Infinity);
  who.fill(-1);
  let moved = null;
  if (canTouch && $("touches").checked) {
    moved = new Map();
    for (let k = t.starts[sample]; k < t.starts[sample + 1]; k++) moved.set(t.points[k], k);
  }
  drawCloud(l, moved);
  const first = 7 * links * sample;
  if (t && $("robot").checked) drawRobot(l, t.poses, first);
  if (moved !== null) drawTouches(l, moved);
  context.putImageData(image, 0, 0);
  if (t && $("frames").checked) drawFrames(l, t.poses, first);
  drawAxes(l);
}

// A frame when something has changed; while it moves, a coarse one where fine ones are slow.
let wanted = false, slow = false, settle = 0;
function refresh(moving) {
  if (moving && slow) {
    clearTimeout(settle);
    settle = setTimeout(() => refresh(false), 200);
  }
  if (wanted) return;
  wanted = true;
  requestAnimationFrame(() => {
    wanted = false;
    const begin = performance.now();
    draw(moving && slow);
    const cost = performance.now() - begin;
    if (!moving || !slow) slow = cost > 60;
  });
}

// ---- Pointer and keys ---------------------------------------------------------------------------

const held = new Map();

function turn(dx, dy) {
  camera.azimuth -= 0.4 * dx;
  camera.elevation = Math.min(89, Math.max(-89, camera.elevation + 0.4 * dy));
}
function shift(dx, dy) {
  const l = lens(), f = camera.distance / l.focal * W / stage.clientWidth;
  camera.target = camera.target.map((v, k) => v - f * (dx * l.right[k] + dy * l.down[k]));
}
function zoom(factor) {
  camera.distance = Math.min(100 * (apart || bounds).radius, Math.max(0.05 * bounds.radius, camera.distance * factor));
}

stage.addEventListener("pointerdown", e => {
  stage.setPointerCapture(e.pointerId);
  held.set(e.pointerId, [e.clientX, e.clientY]);
});
stage.addEventListener("pointermove", e => {
  const old = held.get(e.pointerId);
  if (!old) return probe(e);
  const now = [e.clientX, e.clientY], [dx, dy] = [now[0] - old[0], now[1] - old[1]];
  if (held.size === 2) {
    const other = [...held].find(([id]) => id !== e.pointerId)[1];
    const span = p => Math.hypot(p[0] - other[0], p[1] - other[1]);
    zoom(span(old) / Math.max(1, span(now)));
    shift(dx / 2, dy / 2);
  } else if (e.shiftKey || e.buttons & 6) shift(dx, dy);
  else turn(dx, dy);
  held.set(e.pointerId, now);
  refresh(true);
});
for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, e => {
  held.delete(e.pointerId);
  probe(e);
});
stage.addEventListener("contextmenu", e => e.preventDefault());
stage.addEventListener("wheel", e => {
  e.preventDefault();
  zoom(Math.exp(Math.max(-1, Math.min(1, 0.002 * e.deltaY * (e.deltaMode === 1 ? 16 : 1)))));
  refresh(true);
}, { passive: false });
stage.addEventListener("keydown", e => {
  const step = { ArrowLeft: [20, 0], ArrowRight: [-20, 0], ArrowUp: [0, 20], ArrowDown: [0, -20] }[e.key];
  if (step) turn(...step);
  else if (e.key === "+" || e.key === "-") zoom(e.key === "+" ? 0.85 : 1.18);
  else return;
  e.preventDefault();
  refresh(true);
});

/** What is under the pointer. */
function probe(e) {
  const box = stage.getBoundingClientRect();
  const x = Math.floor((e.clientX - box.left) * W / box.width), y = Math.floor((e.clientY - box.top) * H / box.height);
  const i = x >= 0 && y >= 0 && x < W && y < H ? who[y * W + x] : -1;
  let text = "";
  if (i >= 0) {
    text = [0, 1, 2].map(k => (points[3 * i + k] + data.origin[k]).toFixed(3)).join(", ") + " m";
    for (const l of layers) text += `, ${l.name} ${number(l.values[i])} ${l.unit}`;
    if (touched !== null && touched[i] === 0) text += ", untouched";
  }
  $("probe").textContent = text;
}

// ---- Controls -----------------------------------------------------------------------------------

function showLayer() {
  const shown = layers[layer];
  $("scale").hidden = !shown;
  if (shown) {
    $("quantity").textContent = `${shown.name} [${shown.unit}]`;
    $("ticks").replaceChildren(...[0, 0.25, 0.5, 0.75, 1].map((f, k) => {
      const tick = document.createElement("span");
      tick.textContent = number(f * shown.limit) + (k === 4 ? " or more" : "");
      return tick;
    }));
    $("least-value").textContent = `${number(shown.limit * $("least").value / 100)} ${shown.unit}`;
  }
  $("gray-of").hidden = !shown || touched === null || $("untouched").value !== "gray";
  paint();
  refresh(false);
}

/** The number of touched points and the load over the sequence, and where we are. */
function drawCourse() {
  const canvas = $("course"), t = tracks[track], c = canvas.getContext("2d");
  const unit = Math.min(window.devicePixelRatio || 1, 2);
  const w = canvas.width = Math.max(1, Math.round(canvas.clientWidth * unit));
  const h = canvas.height = Math.max(1, Math.round(canvas.clientHeight * unit));
  const last = Math.max(1, t.time.length - 1), x = k => 1 + (w - 2) * k / last;
  const curve = values => {
    const most = values.reduce((a, b) => Math.max(a, b), 0) || 1;
    c.beginPath();
    values.forEach((v, k) => c.lineTo(x(k), h - 1 - (h - 4) * v / most));
  };
  curve(t.counts);
  c.lineTo(w - 1, h);
  c.lineTo(1, h);
  c.fillStyle = "#e1e7ed";
  c.fill();
  curve(t.loads);
  c.strokeStyle = "#d55e00";
  c.lineWidth = 1.5 * unit;
  c.stroke();
  c.fillStyle = "#1b2430";
  c.fillRect(x(sample) - unit / 2, 0, unit, h);
}

function showSample() {
  const t = tracks[track];
  $("sample").value = sample;
  let text = `${number(t.time[sample])} s, sample ${sample * motion.every}`;
  const touching = t.counts[sample];
  if (canTouch) text += `, ${touching} ${touching === 1 ? "point" : "points"} touched, load ${number(t.loads[sample])} ${motion.unit}`;
  $("now").textContent = text;
  if (canTouch) drawCourse();
  refresh(playing);
}

function showTrack() {
  const t = tracks[track];
  // Begin where most is touched, but with a field, which is what to see, where touch begins.
  const most = t.counts.reduce((a, b) => Math.max(a, b), 0);
  sample = Math.max(0, t.counts.findIndex(c => layers.length === 0 ? c === most : c > 0));
  $("sample").max = t.time.length - 1;
  setPlaying(false);
  $("course-of").textContent = canTouch
    ? `Gray: touched points, at most ${t.counts.reduce((a, b) => Math.max(a, b), 0)}. Orange: norm of the external torques, at most ${number(t.loads.reduce((a, b) => Math.max(a, b), 0))} ${motion.unit}.`
    : "";
  showSample();
}

/** How many times as fast as it was: a sequence takes 20 s at most. */
const pace = () => Math.max(1, tracks[track].time[tracks[track].time.length - 1] / 20);

let before = 0, clock = 0;
function play(now) {
  if (!playing) return;
  const t = tracks[track], end = t.time.length - 1;
  clock += pace() * Math.min(0.2, (now - before) / 1000);
  before = now;
  while (sample < end && t.time[sample + 1] <= clock) sample++;
  if (sample >= end) setPlaying(false);
  showSample();
  requestAnimationFrame(play);
}
function setPlaying(on) {
  playing = on;
  $("play").textContent = on ? "Pause" : pace() > 1.5 ? `Play ${Math.round(pace())} times as fast` : "Play";
  if (!on) return refresh(false);
  if (sample >= tracks[track].time.length - 1) sample = 0;
  clock = tracks[track].time[sample];
  before = performance.now();
  requestAnimationFrame(play);
}

layers.forEach((l, k) => {
  const label = document.createElement("label"), radio = document.createElement("input");
  Object.assign(radio, { type: "radio", name: "layer", checked: k === 0 });
  radio.addEventListener("change", () => { layer = k; showLayer(); });
  label.append(radio, l.name[0].toUpperCase() + l.name.slice(1));
  $("layers").append(label);
});
for (const t of tracks) $("sequence").append(new Option(`sequence ${t.id}`));
for (const e of document.querySelectorAll(".moving")) e.hidden = tracks.length === 0;
for (const e of document.querySelectorAll(".touching")) e.hidden = !canTouch;
$("course").hidden = !canTouch;
$("layers").hidden = layers.length < 2;
$("least-of").hidden = layers.length === 0;
$("untouched-of").hidden = touched === null || layers.length === 0;
// Points that nothing is known of would stand before those that were touched.
if (touched !== null && touched.some(v => v === 1) && layers.length > 0) $("untouched").value = "hidden";
$("robot-of").hidden = surfaces.length === 0;
$("frames").checked = surfaces.length === 0;
$("gradient").style.background = `linear-gradient(to right, ${data.palette.map(c => `rgb(${c})`)})`;
const span = k => `${"xyz"[k]} ${[focus.low[k], focus.high[k]].map(v => (v + data.origin[k]).toFixed(3)).join(" to ")} m`;
const count = touched === null ? `${cloud.total} points` : `${cloud.touches} of ${cloud.total} points touched`;
$("extent").textContent = cloud.total === 0 ? "No points." : `${count}, ${[0, 1, 2].map(span).join(", ")}`;

for (const id of ["least", "untouched"]) $(id).addEventListener("input", showLayer);
for (const id of ["robot", "frames", "touches"]) $(id).addEventListener("change", () => refresh(false));
$("reset").addEventListener("click", () => { camera = start(); refresh(false); });
$("sequence").addEventListener("change", e => { track = e.target.selectedIndex; showTrack(); });
$("sample").addEventListener("input", e => { setPlaying(false); sample = Number(e.target.value); showSample(); });
$("play").addEventListener("click", () => setPlaying(!playing));
window.addEventListener("resize", () => { refresh(false); if (canTouch) drawCourse(); });

paint();
camera = start();
showLayer();
if (tracks.length > 0) showTrack();

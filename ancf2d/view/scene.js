"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const el = (id) => document.getElementById(id);
const LIGHT = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];
const DARK = ["#56b4e9", "#ff8a3d", "#2fc79b", "#e39cc6", "#f0b429", "#8fd0f5", "#ffffff"];

// ------------------------------------------------------------------ numbers

function unpack(text, Type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
}
const reference = unpack(data.reference, Float32Array);
const moves = unpack(data.moves, Int16Array);
const width = reference.length;
const frames = data.t.length;
const modal = data.kind === "modes";
const timed = data.kind === "time";
for (const p of data.probes) {
  p.t = unpack(p.t, Float64Array);
  p.values = unpack(p.values, Float64Array);
  p.rows = unpack(p.rows, Float32Array);
}
const monotone = data.t.every((t, i) => i === 0 || t > data.t[i - 1]);
// what the slider runs over: time or load where it only grows, else the number of the state
const axis = modal ? [] : monotone ? data.t : data.t.map((_, i) => i);
const span = axis.length ? axis[axis.length - 1] - axis[0] : 0;
const PLAY = 8; // seconds that the whole run takes at first
const state = {
  at: axis.length ? axis[0] : 0, mode: 0, phase: 0, playing: false, speed: 1, magnify: data.magnify, follow: false,
  view: null, curve: 0, dark: matchMedia("(prefers-color-scheme: dark)").matches,
};

function format(x) {
  if (x === 0) return "0";
  const size = Math.abs(x);
  return size >= 1e-3 && size < 1e5 ? String(Number(x.toPrecision(5))) : x.toExponential(3);
}
function unit(u) {
  return u && u !== "1" ? " " + u.replace("*", "·").replace("^2", "²") : "";
}

// position among the states as a number whose whole part is a state
function place() {
  if (frames < 2) return 0;
  let low = 0;
  let high = frames - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (axis[middle] <= state.at) low = middle;
    else high = middle;
  }
  return low + Math.min(1, Math.max(0, (state.at - axis[low]) / (axis[high] - axis[low])));
}
const points = new Float32Array(width);
function move() {
  const factor = data.step * state.magnify;
  if (modal) {
    const first = state.mode * width;
    const swing = factor * Math.cos(state.phase);
    for (let i = 0; i < width; i++) points[i] = reference[i] + swing * moves[first + i];
    return;
  }
  const p = place();
  const a = Math.floor(p);
  const b = Math.min(a + 1, frames - 1);
  const w = p - a;
  for (let i = 0; i < width; i++) {
    points[i] = reference[i] + factor * ((1 - w) * moves[a * width + i] + w * moves[b * width + i]);
  }
}

// ------------------------------------------------------------------ the stage

const stage = el("scene");
const pen = stage.getContext("2d");
function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
function color(i) {
  return (state.dark ? DARK : LIGHT)[i % LIGHT.length];
}
function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const box = canvas.getBoundingClientRect();
  const w = Math.max(1, Math.round(box.width * ratio));
  const h = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  canvas.getContext("2d").setTransform(ratio, 0, 0, ratio, 0, 0);
  return [box.width, box.height];
}
function box(values, found) {
  for (let i = 0; i < width; i += 2) {
    if (values[i] < found[0]) found[0] = values[i];
    if (values[i] > found[2]) found[2] = values[i];
    if (values[i + 1] < found[1]) found[1] = values[i + 1];
    if (values[i + 1] > found[3]) found[3] = values[i + 1];
  }
  return found;
}
function everything() {
  const found = box(reference, [Infinity, Infinity, -Infinity, -Infinity]);
  const kept = [state.at, state.phase];
  const all = modal ? [0, Math.PI] : axis.filter((_, i) => i % Math.ceil(frames / 60) === 0 || i === frames - 1);
  for (const at of all) {
    if (modal) state.phase = at;
    else state.at = at;
    move();
    box(points, found);
  }
  [state.at, state.phase] = kept;
  return found;
}
function fit() {
  const [w, h] = fitted(stage);
  const [x0, y0, x1, y1] = everything();
  const scale = Math.min((w - 110) / Math.max(x1 - x0, 1e-9 * data.extent), (h - 150) / Math.max(y1 - y0, data.extent / 50));
  state.view = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale };
}
function centre() {
  const [x0, y0, x1, y1] = box(points, [Infinity, Infinity, -Infinity, -Infinity]);
  return [(x0 + x1) / 2, (y0 + y1) / 2];
}
function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].map((m) => m * power).find((m) => m >= step);
}
function grid(w, h, X, Y) {
  const v = state.view;
  const step = nice(80 / v.scale);
  pen.lineWidth = 1;
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = css("--soft");
  pen.strokeStyle = css("--grid");
  for (let k = Math.ceil((v.x - w / 2 / v.scale) / step); k * step < v.x + w / 2 / v.scale; k++) {
    pen.beginPath(); pen.moveTo(X(k * step), 0); pen.lineTo(X(k * step), h); pen.stroke();
    pen.fillText(format(k * step), X(k * step) + 3, h - 5);
  }
  for (let k = Math.ceil((v.y - h / 2 / v.scale) / step); k * step < v.y + h / 2 / v.scale; k++) {
    pen.beginPath(); pen.moveTo(0, Y(k * step)); pen.lineTo(w, Y(k * step)); pen.stroke();
    if (Y(k * step) > 60 && Y(k * step) < h - 20) pen.fillText(format(k * step) + unit(data.units.length), 4, Y(k * step) - 4);
  }
}
// one closed outline of a whole body, or of each of its elements where all are there: end faces may part
function outline(body, values, X, Y) {
  const half = body.elements * body.samples;
  const to = (k, move) => {
    const i = 2 * (body.first + k);
    if (move) pen.moveTo(X(values[i]), Y(values[i + 1]));
    else pen.lineTo(X(values[i]), Y(values[i + 1]));
  };
  const runs = body.pieces ? body.elements : 1;
  const n = half / runs;
  pen.beginPath();
  for (let r = 0; r < runs; r++) {
    for (let k = 0; k < n; k++) to(r * n + k, k === 0);
    for (let k = n - 1; k >= 0; k--) to(half + r * n + k, false);
    pen.closePath();
  }
}
function edges(body, values, X, Y, joined = !body.pieces) {
  const half = body.elements * body.samples;
  pen.beginPath();
  for (const side of [0, half]) {
    for (let k = 0; k < half; k++) {
      const i = 2 * (body.first + side + k);
      if (k === 0 || (!joined && k % body.samples === 0)) pen.moveTo(X(values[i]), Y(values[i + 1]));
      else pen.lineTo(X(values[i]), Y(values[i + 1]));
    }
  }
  for (const k of [0, half - 1]) {
    const i = 2 * (body.first + k);
    const j = i + 2 * half;
    pen.moveTo(X(values[i]), Y(values[i + 1]));
    pen.lineTo(X(values[j]), Y(values[j + 1]));
  }
}
function drawScene() {
  const [w, h] = fitted(stage);
  if (!state.view) fit();
  move();
  if (state.follow) [state.view.x, state.view.y] = centre();
  const v = state.view;
  const X = (x) => w / 2 + (x - v.x) * v.scale;
  const Y = (y) => h / 2 - (y - v.y) * v.scale;
  pen.clearRect(0, 0, w, h);
  grid(w, h, X, Y);
  if (el("reference").checked) {
    pen.strokeStyle = css("--reference");
    pen.setLineDash([5, 4]);
    for (const body of data.bodies) { edges(body, reference, X, Y, true); pen.stroke(); }
    pen.setLineDash([]);
  }
  data.bodies.forEach((body, i) => {
    pen.fillStyle = color(i);
    pen.strokeStyle = color(i);
    pen.globalAlpha = 0.28;
    outline(body, points, X, Y); pen.fill("nonzero");
    pen.globalAlpha = 1;
    pen.lineWidth = 1.8;
    pen.lineJoin = "round";
    edges(body, points, X, Y); pen.stroke();
    if (el("nodes").checked) drawNodes(body, X, Y);
  });
}
function drawNodes(body, X, Y) {
  const first = 2 * (body.first + 2 * body.elements * body.samples);
  pen.lineWidth = 1;
  const ink = pen.strokeStyle;
  pen.strokeStyle = css("--back");
  for (let k = 0; k < body.nodes; k++) {
    pen.beginPath();
    pen.arc(X(points[first + 2 * k]), Y(points[first + 2 * k + 1]), 3.2, 0, 7);
    pen.fill(); pen.stroke();
  }
  pen.strokeStyle = ink;
}

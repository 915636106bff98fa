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
const solid = 2 * data.solid; // numbers of the bodies: those of symbols follow
const frames = data.t.length;
const modal = data.kind === "modes";
const timed = data.kind === "time";
for (const series of data.series) {
  series.t = unpack(series.t, Float64Array);
  series.rows = unpack(series.rows, Float32Array);
}
for (const p of data.probes) p.values = unpack(p.values, Float64Array);
for (const way of data.traces) {
  way.ux = unpack(way.ux, Float32Array);
  way.uy = unpack(way.uy, Float32Array);
}
// of points that move along bodies: they are not magnified
const ways = data.ways || [];
for (const one of ways) one.way = unpack(one.way, Float32Array);
for (const f of data.fields) f.values = unpack(f.values, Uint8Array);
const monotone = data.t.every((t, i) => i === 0 || t > data.t[i - 1]);
// what the slider runs over: time or load where it only grows, else the number of the state
const axis = modal ? [] : monotone ? data.t : data.t.map((_, i) => i);
const span = axis.length ? axis[axis.length - 1] - axis[0] : 0;
const PLAY = 8; // seconds that the whole run takes at first
const state = {
  at: axis.length ? axis[0] : 0, mode: 0, phase: 0, playing: false, speed: 1, magnify: data.magnify, follow: false,
  view: null, curve: 0, field: -1, dark: matchMedia("(prefers-color-scheme: dark)").matches,
};

function format(x) {
  if (x === 0) return "0";
  const size = Math.abs(x);
  return size >= 1e-3 && size < 1e5 ? String(Number(x.toPrecision(5))) : x.toExponential(3);
}
const NAMED = { "N/m^2": "Pa", "N/mm^2": "MPa", "kN/m^2": "kPa" };
function pretty(u) {
  return (NAMED[u] || u || "1").replaceAll("*", "·").replaceAll("^2", "²").replaceAll("^3", "³");
}
function unit(u) {
  return u && u !== "1" ? " " + pretty(u) : "";
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
    if (!data.turning) return;
    const later = first + frames * width;
    const turn = factor * Math.sin(state.phase);
    for (let i = 0; i < width; i++) points[i] += turn * moves[later + i];
    return;
  }
  const p = place();
  const a = Math.floor(p);
  const b = Math.min(a + 1, frames - 1);
  const w = p - a;
  for (let i = 0; i < width; i++) {
    points[i] = reference[i] + factor * ((1 - w) * moves[a * width + i] + w * moves[b * width + i]);
  }
  for (const { point, way } of ways) {
    for (let c = 0; c < 2; c++) points[2 * point + c] += (1 - w) * way[2 * a + c] + w * way[2 * b + c];
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
function stretch(found, x, y) {
  if (x < found[0]) found[0] = x;
  if (x > found[2]) found[2] = x;
  if (y < found[1]) found[1] = y;
  if (y > found[3]) found[3] = y;
}
function box(values, found) {
  for (let i = 0; i < solid; i += 2) stretch(found, values[i], values[i + 1]);
  return found;
}
// the other ends of springs may be far from all bodies
const ends = data.symbols.filter((s) => s.kind === "spring" || s.kind === "tendon").flatMap((s) => [s.first, s.first + 1]);
function everything() {
  const found = box(reference, [Infinity, Infinity, -Infinity, -Infinity]);
  const kept = [state.at, state.phase];
  const all = modal ? [0, 0.5 * Math.PI, Math.PI, 1.5 * Math.PI] : axis.filter((_, i) => i % Math.ceil(frames / 60) === 0 || i === frames - 1);
  for (const at of all) {
    if (modal) state.phase = at;
    else state.at = at;
    move();
    box(points, found);
    for (const k of ends) stretch(found, points[2 * k], points[2 * k + 1]);
  }
  [state.at, state.phase] = kept;
  return found;
}
function fit() {
  const [w, h] = fitted(stage);
  const [x0, y0, x1, y1] = everything();
  const room = [w - GUTTER.left - 2 * PAD, h - GUTTER.bottom - 2 * PAD];
  const scale = Math.min(room[0] / Math.max(x1 - x0, 1e-9 * data.extent), room[1] / Math.max(y1 - y0, data.extent / 50));
  state.view = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: Math.max(scale, 1e-300) };
}
function centre() {
  const [x0, y0, x1, y1] = box(points, [Infinity, Infinity, -Infinity, -Infinity]);
  return [(x0 + x1) / 2, (y0 + y1) / 2];
}
// ------------------------------------------------------------------ axes

const FONT = "11px system-ui, sans-serif";
const PAD = 40; // pixels about the bodies
const GUTTER = { left: 52, bottom: 38 }; // of a picture, for the numbers and names of its axes
function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].map((m) => m * power).find((m) => m >= step);
}
// round numbers in a range as texts, with the power of ten that they are counted in
function ticks(low, high, step) {
  const power = 3 * Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high))) / 3);
  const exponent = power >= 6 || power <= -6 ? power : 0;
  const out = [];
  for (let k = Math.ceil(low / step); k * step <= high && out.length < 200; k++) {
    const value = k * step;
    out.push({ value, text: String(Number((value / 10 ** exponent).toPrecision(7))) });
  }
  return { out, exponent };
}
const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
function named(name, units, exponent) {
  const times = exponent ? "10" + [...String(exponent)].map((c) => RAISED[c]).join("") : "";
  const parts = [times, units && units !== "1" ? pretty(units) : times ? "" : "1"].filter(Boolean);
  return `${name} [${parts.join(" ")}]`;
}
// grid, numbers and names of both axes about the area [left, right, top, bottom]
function axes(ink, area, X, Y, xs, ys, names) {
  const [left, right, top, bottom] = area;
  ink.lineWidth = 1;
  ink.font = FONT;
  ink.fillStyle = css("--soft");
  ink.textAlign = "center";
  let free = -Infinity; // where the number before ends
  for (const { value, text } of xs.out) {
    const x = X(value);
    if (x < left || x > right) continue;
    ink.beginPath(); ink.moveTo(x, top); ink.lineTo(x, bottom); ink.stroke();
    const half = ink.measureText(text).width / 2;
    if (x - half < Math.max(free, left - 20) || x + half > right + 8) continue;
    ink.fillText(text, x, bottom + 15);
    free = x + half + 6;
  }
  ink.textAlign = "right";
  ink.fillText(names[0], right, bottom + 31);
  for (const { value, text } of ys.out) {
    const y = Y(value);
    if (y < top || y > bottom) continue;
    ink.beginPath(); ink.moveTo(left, y); ink.lineTo(right, y); ink.stroke();
    ink.fillText(text, left - 6, y + 4);
  }
  ink.textAlign = "left";
  ink.fillText(names[1], 6, top - 8);
}
function widest(ink, found) {
  ink.font = FONT;
  return Math.max(...found.out.map(({ text }) => ink.measureText(text).width), 0);
}
const limits = (centre, pixels, scale) => [centre - pixels / 2 / scale, centre + pixels / 2 / scale];

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
// where the plane is on the canvas: beside the numbers of its axes
function mapping(w, h) {
  const v = state.view;
  const step = nice(80 / v.scale);
  const ys = ticks(...limits(v.y, h, v.scale), nice(60 / v.scale));
  const left = Math.max(GUTTER.left, widest(pen, ys) + 14);
  const [right, top, bottom] = [w - 10, 24, h - GUTTER.bottom];
  const [cx, cy] = [(left + right) / 2, (top + bottom) / 2];
  return {
    area: [left, right, top, bottom], ys, xs: ticks(...limits(v.x, w, v.scale), step),
    X: (x) => cx + (x - v.x) * v.scale, Y: (y) => cy - (y - v.y) * v.scale, cx, cy,
  };
}
function drawScene() {
  const [w, h] = fitted(stage);
  if (!state.view) fit();
  move();
  if (state.follow) [state.view.x, state.view.y] = centre();
  const m = mapping(w, h);
  const { X, Y, area } = m;
  const names = [named("x", data.units.length, m.xs.exponent), named("y", data.units.length, m.ys.exponent)];
  pen.clearRect(0, 0, w, h);
  pen.strokeStyle = css("--grid");
  axes(pen, area, X, Y, m.xs, m.ys, names);
  stage.dataset.axes = names.join("; ");
  pen.save();
  pen.beginPath();
  pen.rect(area[0], area[2], area[1] - area[0], area[3] - area[2]);
  pen.clip();
  drawObstacles(X, Y);
  drawBodies(X, Y);
  if (el("trace").checked) drawTraces(X, Y);
  if (el("symbols").checked) drawSymbols(X, Y, area);
  pen.restore();
}
// solids that bodies touch: filled, with their surface as lines
function drawObstacles(X, Y) {
  for (const obstacle of data.obstacles) {
    let first = obstacle.first;
    obstacle.counts.forEach((count, k) => {
      pen.beginPath();
      for (let i = first; i < first + count; i++) pen.lineTo(X(points[2 * i]), Y(points[2 * i + 1]));
      first += count;
      pen.fillStyle = pen.strokeStyle = css("--reference");
      pen.globalAlpha = k === 0 ? 0.18 : 1;
      pen.lineWidth = 1.2;
      if (k === 0) pen.fill();
      else pen.stroke();
    });
  }
  pen.globalAlpha = 1;
}
function drawBodies(X, Y) {
  if (el("reference").checked) {
    pen.strokeStyle = css("--reference");
    pen.lineWidth = 1;
    pen.setLineDash([5, 4]);
    for (const body of data.bodies) { edges(body, reference, X, Y, true); pen.stroke(); }
    pen.setLineDash([]);
  }
  data.bodies.forEach((body, i) => {
    pen.fillStyle = color(i);
    pen.strokeStyle = color(i);
    if (!drawField(i, X, Y)) {
      pen.globalAlpha = 0.28;
      outline(body, points, X, Y); pen.fill("nonzero");
      pen.globalAlpha = 1;
    }
    pen.fillStyle = color(i);
    pen.strokeStyle = color(i);
    pen.lineWidth = state.field < 0 ? 1.8 : 1;
    pen.lineJoin = "round";
    edges(body, points, X, Y); pen.stroke();
    if (el("nodes").checked) drawNodes(body, X, Y);
  });
}
const APART = 9; // pixels: nodes that are closer to each other would hide the body
function drawNodes(body, X, Y) {
  const first = 2 * (body.first + 2 * body.elements * body.samples);
  const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
  for (let k = 0; k < 2 * body.nodes; k++) {
    low[k % 2] = Math.min(low[k % 2], points[first + k]);
    high[k % 2] = Math.max(high[k % 2], points[first + k]);
  }
  if (state.view.scale * Math.hypot(high[0] - low[0], high[1] - low[1]) < APART * (body.nodes - 1)) return;
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

// ------------------------------------------------------------------ the probe's plot

const plot = el("plot");
const plotPen = plot.getContext("2d");
let frame = null; // of the plot in pixels and values
// over time; load against the quantity in statics
function curve() {
  const p = data.probes[state.curve];
  const { t } = data.series[p.series];
  return timed ? { x: t, y: p.values, p } : { x: p.values, y: t, p };
}
function range(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  const pad = 0.06 * (high - low) || 0.06 * Math.abs(low) || 1;
  return [low - pad, high + pad];
}
// where the state shown is among the rows of a series, between two of them too
function rowNow({ rows }) {
  const at = place();
  const a = Math.floor(at);
  return (1 - at + a) * rows[a] + (at - a) * rows[Math.min(a + 1, frames - 1)];
}
function now(p) {
  const row = rowNow(data.series[p.series]);
  const k = Math.min(Math.floor(row), p.values.length - 2);
  return (v) => v[k] + (row - k) * (v[k + 1] - v[k]);
}
function drawPlot() {
  if (!data.probes.length) return;
  const [w, h] = fitted(plot);
  const { x, y, p } = curve();
  const [xr, yr] = [range(x), range(y)];
  const ys = ticks(...yr, nice((yr[1] - yr[0]) / Math.max(2, h / 50)));
  const [left, right, top, bottom] = [Math.max(44, widest(plotPen, ys) + 12), w - 10, 22, h - GUTTER.bottom];
  const xs = ticks(...xr, nice((xr[1] - xr[0]) / Math.max(2, (right - left) / 80)));
  const X = (v) => left + (v - xr[0]) / (xr[1] - xr[0]) * (right - left);
  const Y = (v) => bottom - (v - yr[0]) / (yr[1] - yr[0]) * (bottom - top);
  frame = { left, right, xr };
  plotPen.clearRect(0, 0, w, h);
  plotPen.strokeStyle = css("--line");
  const load = (exponent) => (timed ? named("time", data.units.time, exponent) : named("load factor", "1", exponent));
  const value = (exponent) => named(`${p.probe} ${p.quantity}`, p.units, exponent);
  const names = timed ? [load(xs.exponent), value(ys.exponent)] : [value(xs.exponent), load(ys.exponent)];
  axes(plotPen, [left, right, top, bottom], X, Y, xs, ys, names);
  plot.setAttribute("aria-label", `${names[1]} over ${names[0]}` + (timed ? "; click to go there" : ""));
  line(x, y, X, Y);
  const at = now(p);
  plotPen.fillStyle = css("--accent");
  plotPen.beginPath(); plotPen.arc(X(at(x)), Y(at(y)), 5.5, 0, 7); plotPen.fill();
  el("value").textContent = `${p.probe} ${p.quantity} = ${format(at(p.values))}${unit(p.units)}`;
}
function line(x, y, X, Y) {
  plotPen.strokeStyle = css("--ink");
  plotPen.lineWidth = 1.4;
  plotPen.beginPath();
  for (let i = 0; i < x.length; i++) {
    if (i) plotPen.lineTo(X(x[i]), Y(y[i]));
    else plotPen.moveTo(X(x[i]), Y(y[i]));
  }
  plotPen.stroke();
  plotPen.lineWidth = 1;
}

// ------------------------------------------------------------------ what is said and set

function speak() {
  if (modal) {
    el("readout").textContent = data.modes[state.mode];
    el("now").textContent = `mode ${state.mode + 1} of ${frames}`;
  } else {
    const p = place();
    const a = Math.floor(p);
    const t = data.t[a] + (p - a) * (data.t[Math.min(a + 1, frames - 1)] - data.t[a]);
    el("readout").textContent = timed ? `t = ${format(t)} ${data.units.time}` : `load factor ${format(t)}`;
    el("now").textContent = `state ${Math.round(p) + 1} of ${frames}`;
    el("time").value = state.at;
  }
  const seconds = PLAY / state.speed;
  const real = timed && data.units.time === "s" ? `${format(Number((span / seconds).toPrecision(2)))} × real time` : `${format(Number(seconds.toPrecision(2)))} s for all`;
  el("rate").textContent = modal ? `${Number((0.5 * state.speed).toPrecision(2))} cycles a second` : real;
  el("play").textContent = state.playing ? "pause" : "play";
}
function draw() {
  drawScene();
  drawPlot();
  drawBar();
  speak();
}
let last = 0;
function tick(clock) {
  if (!state.playing) return;
  const passed = Math.min((clock - last) / 1000, 0.1);
  last = clock;
  if (modal) state.phase += Math.PI * passed * state.speed;
  else {
    state.at += passed * state.speed * span / PLAY;
    if (state.at > axis[frames - 1]) {
      state.at = el("loop").checked ? axis[0] : axis[frames - 1];
      if (!el("loop").checked) state.playing = false;
    }
  }
  draw();
  requestAnimationFrame(tick);
}
function play(on) {
  state.playing = on && (modal || frames > 1);
  if (state.playing) {
    if (!modal && state.at >= axis[frames - 1]) state.at = axis[0];
    last = performance.now();
    requestAnimationFrame(tick);
  }
  draw();
}
function go(at) {
  state.at = Math.min(axis[frames - 1], Math.max(axis[0], at));
  draw();
}
function step(by) {
  play(false);
  if (modal) choose(state.mode + by);
  else {
    const k = by > 0 ? Math.floor(place() + 1e-6) + 1 : Math.ceil(place() - 1e-6) - 1;
    go(axis[Math.min(frames - 1, Math.max(0, k))]);
  }
}
function choose(k) {
  state.mode = (k + frames) % frames;
  el("mode").value = String(state.mode);
  state.view = null;
  draw();
}
function theme(dark) {
  state.dark = dark;
  el("theme").textContent = dark ? "light" : "dark";
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  document.documentElement.style.colorScheme = dark ? "dark" : "light";
  el("legend").replaceChildren(...data.bodies.map((body, i) => {
    const item = document.createElement("li");
    const swatch = document.createElement("i");
    swatch.style.background = color(i);
    item.append(swatch, `${body.name} (${body.count} × ${body.element})`);
    return item;
  }));
  draw();
}
function option(select, value, text) {
  const item = document.createElement("option");
  item.value = value;
  item.textContent = text;
  select.append(item);
}

// ------------------------------------------------------------------ hands

function zoom(factor, x, y) {
  const box = stage.getBoundingClientRect();
  const v = state.view;
  const { cx, cy } = mapping(box.width, box.height);
  const [dx, dy] = x === undefined ? [0, 0] : [x - box.left - cx, y - box.top - cy];
  v.x += dx / v.scale * (1 - 1 / factor);
  v.y -= dy / v.scale * (1 - 1 / factor);
  v.scale *= factor;
  draw();
}
stage.addEventListener("wheel", (e) => {
  e.preventDefault();
  zoom(Math.exp(-0.0015 * e.deltaY), e.clientX, e.clientY);
}, { passive: false });
const fingers = new Map();
stage.addEventListener("pointerdown", (e) => {
  stage.setPointerCapture(e.pointerId);
  fingers.set(e.pointerId, [e.clientX, e.clientY]);
});
stage.addEventListener("pointermove", (e) => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  const others = [...fingers].filter(([id]) => id !== e.pointerId).map(([, at]) => at);
  fingers.set(e.pointerId, [e.clientX, e.clientY]);
  if (others.length) {
    const apart = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
    zoom(apart([e.clientX, e.clientY]) / Math.max(apart(before), 1), others[0][0], others[0][1]);
    return;
  }
  state.follow = false;
  el("follow").setAttribute("aria-pressed", "false");
  state.view.x -= (e.clientX - before[0]) / state.view.scale;
  state.view.y += (e.clientY - before[1]) / state.view.scale;
  draw();
});
for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, (e) => fingers.delete(e.pointerId));
stage.addEventListener("dblclick", () => { state.view = null; draw(); });
function seek(e) {
  if (!frame || !timed) return;
  const box = plot.getBoundingClientRect();
  const share = (e.clientX - box.left - frame.left) / (frame.right - frame.left);
  go(frame.xr[0] + share * (frame.xr[1] - frame.xr[0]));
}
plot.addEventListener("pointerdown", seek);
plot.addEventListener("pointermove", (e) => { if (e.buttons) seek(e); });
el("play").addEventListener("click", () => play(!state.playing));
el("fit").addEventListener("click", () => { state.view = null; draw(); });
el("follow").addEventListener("click", () => {
  state.follow = !state.follow;
  el("follow").setAttribute("aria-pressed", String(state.follow));
  draw();
});
el("theme").addEventListener("click", () => theme(!state.dark));
el("time").addEventListener("input", () => { state.playing = false; go(Number(el("time").value)); });
el("speed").addEventListener("input", () => { state.speed = 2 ** Number(el("speed").value); speak(); });
el("magnify").addEventListener("change", () => { state.magnify = Number(el("magnify").value); state.view = null; draw(); });
el("mode").addEventListener("change", () => choose(Number(el("mode").value)));
el("curve").addEventListener("change", () => { state.curve = Number(el("curve").value); draw(); });
el("field").addEventListener("change", () => { state.field = Number(el("field").value); draw(); });
for (const name of ["reference", "nodes", "symbols", "trace", "loop"]) el(name).addEventListener("change", draw);
// the same keys wherever the focus is; what has the focus is worked with Enter, up and down
const KEYS = {
  " ": () => play(!state.playing), ArrowRight: () => step(1), ArrowLeft: () => step(-1), Home: () => jump(0), End: () => jump(frames - 1),
  "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: () => { state.view = null; draw(); },
};
function jump(k) {
  play(false);
  if (modal) choose(k);
  else go(axis[k]);
}
document.addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const checkbox = e.target.type === "checkbox";
  const does = KEYS[e.key] || (checkbox && e.key === "Enter" ? () => e.target.click() : null);
  if (!does) return;
  e.preventDefault();
  does();
}, true);
// a button would be pressed as the space bar comes up
document.addEventListener("keyup", (e) => { if (e.key === " ") e.preventDefault(); }, true);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (e) => theme(e.matches));
window.addEventListener("resize", () => { state.view = null; draw(); });

// ------------------------------------------------------------------ the beginning

el("title").textContent = data.title;
const many = modal ? "modes" : "states";
el("about").textContent = `${data.file}, ${data.solver.replace("_", " ")}` + (data.status === "converged" ? "" : `, ${data.status}`)
  + (frames < data.stored ? `, ${frames} of ${data.stored} ${many}` : `, ${frames} ${many}`);
data.probes.forEach((p, i) => option(el("curve"), i, `${p.probe} ${p.quantity}`));
// the curve is the goal's; without one, a displacement
const lively = ["uy", "ux", "theta", "y", "x"].map((q) => data.probes.findIndex((p) => p.quantity === q)).find((i) => i >= 0);
state.curve = data.goal ?? lively ?? 0;
el("curve").value = String(state.curve);
option(el("field"), -1, "bodies");
data.fields.forEach((f, i) => option(el("field"), i, f.name));
state.field = data.fields.length ? 0 : -1;
el("field").value = String(state.field);
el("coloured").hidden = !data.fields.length;
el("symbols").parentElement.hidden = !data.symbols.length;
el("trace").parentElement.hidden = !data.traces.length;
for (const s of data.symbols) {
  const [i, j] = [2 * s.first, 2 * s.arm];
  s.start = s.arm === null ? 0 : Math.atan2(reference[j + 1] - reference[i + 1], reference[j] - reference[i]);
}
el("side").hidden = !data.probes.length;
el("choice").hidden = !modal;
(data.modes || []).forEach((text, i) => option(el("mode"), i, text));
for (const m of [...new Set([data.magnify, 1, 2, 5, 10, 100, 1000])].sort((a, b) => a - b)) option(el("magnify"), m, m === 1 ? "true size" : `× ${format(m)}`);
el("magnify").value = String(state.magnify);
if (modal) { el("time").hidden = true; el("loop").parentElement.hidden = true; } else {
  el("time").min = axis[0];
  el("time").max = axis[frames - 1];
}
theme(state.dark);
if (!timed && !modal) go(axis[frames - 1]);
document.documentElement.dataset.ready = "yes";

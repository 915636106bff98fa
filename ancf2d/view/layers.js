// ------------------------------------------------------------------ fields

// red in tension, blue in compression, pale at nothing; and colours whose lightness grows evenly
const SIGNED = ["#053061", "#2166ac", "#4393c3", "#92c5de", "#f7f7f7", "#f4a582", "#d6604d", "#b2182b", "#67001f"];
const GROWING = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#fee838"];
const LARGEST = 255; // code of a field's highest value; 0 is no number
const THIN = 8; // pixels: what is thinner is shown that thick
const tables = new Map();
function table(stops) {
  if (!tables.has(stops)) {
    const parts = stops.map((c) => [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16)));
    tables.set(stops, Array.from({ length: LARGEST + 1 }, (_, code) => {
      const at = Math.max(0, code - 1) / (LARGEST - 1) * (stops.length - 1);
      const k = Math.min(Math.floor(at), stops.length - 2);
      return `rgb(${parts[k].map((c, j) => Math.round(c + (at - k) * (parts[k + 1][j] - c))).join(",")})`;
    }));
  }
  return tables.get(stops);
}
const stops = (field) => (field.signed ? SIGNED : GROWING);
// the values of all points of a field at the state shown, between those of the states for which it is stored
function codes(field) {
  const at = place();
  let k = 0;
  while (k < field.frames.length - 2 && field.frames[k + 1] <= at) k++;
  const next = Math.min(k + 1, field.frames.length - 1);
  const share = next > k ? Math.min(1, (at - field.frames[k]) / (field.frames[next] - field.frames[k])) : 0;
  const size = field.values.length / field.frames.length;
  return (i) => {
    const [a, b] = [field.values[k * size + i], field.values[next * size + i]];
    return a && b ? a + share * (b - a) : 0;
  };
}
// the parabola through the values at the lower face, the axis and the upper face
function across(low, middle, high, s) {
  if (!low || !middle || !high) return 0;
  const value = low * (1 - s) * (1 - 2 * s) + middle * 4 * s * (1 - s) + high * s * (2 * s - 1);
  return Math.min(Math.max(value, Math.min(low, middle, high)), Math.max(low, middle, high));
}
// lower and upper point of a body's section on the canvas, parted where they would lie in one line
function section(body, sample, X, Y) {
  const i = 2 * (body.first + sample);
  const j = i + 2 * body.elements * body.samples;
  const [x0, y0, x1, y1] = [X(points[i]), Y(points[i + 1]), X(points[j]), Y(points[j + 1])];
  const thick = Math.hypot(x1 - x0, y1 - y0);
  if (thick >= THIN) return [x0, y0, x1, y1];
  const [mx, my] = [(x0 + x1) / 2, (y0 + y1) / 2];
  const grow = thick > 1e-3 ? THIN / 2 / thick : 0;
  return [mx - grow * (x1 - x0), my - grow * (y1 - y0), mx + grow * (x1 - x0), my + grow * (y1 - y0)];
}
function cell(a, b, low, high) {
  const at = (p, s) => [p[0] + s * (p[2] - p[0]), p[1] + s * (p[3] - p[1])];
  pen.beginPath();
  for (const [p, s] of [[a, low], [b, low], [b, high], [a, high]]) pen.lineTo(...at(p, s));
  pen.closePath();
  pen.fill();
  pen.stroke(); // else the background shines through between cells
}
// whether a body has the field that is chosen, which then is drawn
function drawField(i, X, Y) {
  const field = data.fields[state.field];
  if (!field) return false;
  let first = 0;
  for (const part of field.bodies) {
    const body = data.bodies[part.body];
    const stations = (body.samples - 1) / part.every + 1;
    if (part.body === i) {
      drawPart(body, part, stations, first, codes(field), table(stops(field)), X, Y);
      return true;
    }
    first += body.elements * stations * part.across;
  }
  return false;
}
function drawPart(body, part, stations, first, code, colors, X, Y) {
  pen.lineWidth = 0.7;
  for (let e = 0; e < body.elements; e++) {
    let before = null;
    for (let k = 0; k < stations; k++) {
      const p = section(body, e * body.samples + k * part.every, X, Y);
      const at = first + (e * stations + k) * part.across;
      const values = part.across === 1 ? [code(at), code(at), code(at)] : [code(at), code(at + 1), code(at + 2)];
      if (before) {
        const mean = values.map((v, j) => (v && before.values[j] ? (v + before.values[j]) / 2 : 0));
        const strips = part.across === 1 ? 1 : Math.min(16, Math.max(2, Math.round(Math.hypot(p[2] - p[0], p[3] - p[1]) / 3)));
        for (let s = 0; s < strips; s++) {
          const value = across(...mean, (s + 0.5) / strips);
          if (!value) continue;
          pen.fillStyle = pen.strokeStyle = colors[Math.round(value)];
          cell(before.p, p, s / strips, (s + 1) / strips);
        }
      }
      before = { p, values };
    }
  }
}
function drawBar() {
  const field = data.fields[state.field];
  el("bar").hidden = !field;
  if (!field) return;
  el("barname").textContent = `${field.name} [${pretty(field.units)}]`;
  el("low").textContent = format(field.low);
  el("high").textContent = format(field.high);
  el("colors").style.background = `linear-gradient(to right, ${stops(field).join(",")})`;
}

// ------------------------------------------------------------------ traces

function drawTraces(X, Y) {
  const chosen = data.probes.length ? data.probes[state.curve].probe : "";
  for (const way of data.traces) {
    const place = (k) => [X(way.start[0] + state.magnify * way.ux[k]), Y(way.start[1] + state.magnify * way.uy[k])];
    const row = rowNow(data.series[way.series]);
    const whole = Math.floor(row);
    pen.strokeStyle = css("--accent");
    pen.lineWidth = way.probe === chosen ? 1.6 : 1;
    pen.globalAlpha = way.probe === chosen ? 0.95 : 0.45;
    pen.beginPath();
    for (let k = 0; k <= whole; k++) pen.lineTo(...place(k));
    const next = Math.min(whole + 1, way.ux.length - 1);
    const [a, b] = [place(whole), place(next)];
    const end = [0, 1].map((c) => a[c] + (row - whole) * (b[c] - a[c]));
    pen.lineTo(...end);
    pen.stroke();
    pen.fillStyle = css("--accent");
    pen.beginPath(); pen.arc(...end, 2.4, 0, 7); pen.fill();
    pen.globalAlpha = 1;
  }
}

// ------------------------------------------------------------------ supports, joints, springs, masses, loads

const INCH = 96 / 72; // pixels of one point
function turnedBy(symbol) {
  if (symbol.arm === null) return symbol.angle;
  const angle = (from) => Math.atan2(from[2 * symbol.arm + 1] - from[2 * symbol.first + 1], from[2 * symbol.arm] - from[2 * symbol.first]);
  return symbol.angle + angle(points) - symbol.start;
}
function zigzag(ax, ay, bx, by) {
  const [dx, dy] = [bx - ax, by - ay];
  const size = Math.hypot(dx, dy) || 1;
  pen.beginPath();
  pen.moveTo(ax, ay);
  for (let k = 0; k <= 16; k++) {
    const s = 0.2 + 0.6 * k / 16;
    const side = k === 0 || k === 16 ? 0 : (k % 2 ? 1 : -1) * Math.min(6, 0.06 * size) / size;
    pen.lineTo(ax + s * dx - side * dy, ay + s * dy + side * dx);
  }
  pen.lineTo(bx, by);
  pen.stroke();
}
function mark(kind, x, y, angle) {
  const shape = data.outlines[kind];
  const size = shape.unit * INCH;
  const [c, s] = [Math.cos(angle) * size, Math.sin(angle) * size];
  pen.strokeStyle = css(shape.load ? "--load" : "--ink");
  pen.fillStyle = css(shape.filled === "ink" ? "--ink" : "--back");
  pen.lineWidth = 1.2;
  for (const line of shape.lines) {
    pen.beginPath();
    for (const [u, v] of line) pen.lineTo(x + c * u - s * v, y - s * u - c * v);
    const [a, b] = [line[0], line[line.length - 1]];
    if (shape.filled !== "none" && Math.hypot(a[0] - b[0], a[1] - b[1]) < 1e-9) pen.fill();
    pen.stroke();
  }
}
function acts({ acts: [begin, end] }) {
  return data.kind !== "time" || (state.at >= (begin ?? -Infinity) && state.at < (end ?? Infinity));
}
function drawSymbols(X, Y, [, right, top]) {
  let gravities = 0;
  for (const symbol of data.symbols.filter(acts)) {
    const i = 2 * symbol.first;
    if (symbol.kind === "gravity") {
      const half = data.outlines.gravity.unit * INCH;
      const [x, y] = [right - half - 8, top + half + 6 + 52 * gravities++];
      mark("gravity", x + half * Math.cos(symbol.angle), y - half * Math.sin(symbol.angle), symbol.angle);
      pen.fillStyle = css("--load");
      pen.font = "italic 12px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillText("g", x, y + half + 14);
    } else if (symbol.kind === "spring") {
      pen.strokeStyle = css("--ink");
      pen.lineWidth = 1.2;
      zigzag(X(points[i]), Y(points[i + 1]), X(points[i + 2]), Y(points[i + 3]));
    } else if (symbol.kind === "tendon") {
      pen.strokeStyle = css("--load");
      pen.lineWidth = 1.2;
      pen.beginPath();
      pen.moveTo(X(points[i]), Y(points[i + 1]));
      pen.lineTo(X(points[i + 2]), Y(points[i + 3]));
      pen.stroke();
    } else mark(symbol.kind, X(points[i]), Y(points[i + 1]), turnedBy(symbol));
  }
}

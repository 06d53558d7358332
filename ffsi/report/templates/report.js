"use strict";
// Tables: a click on a head sorts, numbers by size.
for (const table of document.querySelectorAll("table.sortable")) {
  table.tHead.addEventListener("click", event => {
    const head = event.target.closest("th"), body = table.tBodies[0];
    if (!head) return;
    const down = head.getAttribute("aria-sort") === "ascending", text = row => row.cells[head.cellIndex].textContent;
    const size = row => parseFloat(text(row).replace("−", "-"));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const rows = [...body.rows].sort((a, b) => {
      const p = size(a), q = size(b);
      if (isNaN(p) !== isNaN(q)) return isNaN(p) ? 1 : -1;
      return (isNaN(p) ? text(a).localeCompare(text(b)) : p - q) * (down ? -1 : 1);
    });
    body.append(...rows);
  });
}
// Galleries: one picture at a time.
for (const slider of document.querySelectorAll(".slider")) {
  const figures = [...slider.querySelectorAll("figure")], tool = document.createElement("div"), input = document.createElement("input");
  const show = () => figures.forEach((figure, i) => { figure.hidden = i !== +input.value; });
  Object.assign(input, { type: "range", min: 0, max: figures.length - 1, value: figures.length - 1 });
  input.setAttribute("aria-label", "which point");
  tool.className = "tool";
  tool.append(input);
  slider.prepend(tool);
  input.addEventListener("input", show);
  show();
}
// Fields: quadratic triangles, each drawn as four linear ones, pixel by pixel; what lies under the pointer is known from there.
const SPLIT = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const digits = value => Number.isFinite(value) ? String(Number(value.toPrecision(4))) : "–";
async function look(viewer) {
  const content = JSON.parse(viewer.querySelector("script").textContent), { nodes, cells, fields } = content;
  const packed = new Blob([bytes(content.data)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(packed).arrayBuffer();
  const x = new Float32Array(buffer, 0, nodes), y = new Float32Array(buffer, 4 * nodes, nodes);
  const values = fields.map((_, i) => new Float32Array(buffer, 4 * nodes * (2 + i), nodes));
  const cell = new Int32Array(buffer, 4 * nodes * (2 + fields.length), 6 * cells);
  const palettes = [content.plain, content.signed].map(text => {
    const rgb = bytes(text);
    return Uint32Array.from({ length: 256 }, (_, i) => (255 << 24 | rgb[3 * i + 2] << 16 | rgb[3 * i + 1] << 8 | rgb[3 * i]) >>> 0);
  });
  const canvas = viewer.querySelector("canvas.field"), pen = canvas.getContext("2d"), select = viewer.querySelector("select");
  const mesh = viewer.querySelector("input"), output = viewer.querySelector(".values"), bar = viewer.querySelector(".scale canvas");
  const [low, high] = viewer.querySelectorAll(".scale span");
  const ends = list => list.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  const [left, right] = ends(x), [bottom, top] = ends(y);
  fields.forEach((field, i) => select.add(new Option(`${field.name} (${field.unit})`, i)));
  let view = null, under = new Int32Array(0), waiting = false;
  const whole = () => {
    const scale = 0.98 * Math.min(canvas.width / (right - left), canvas.height / (top - bottom));
    view = { scale, x: (left + right) / 2, y: (bottom + top) / 2 };
  };
  const px = v => (v - view.x) * view.scale + canvas.width / 2, py = v => canvas.height / 2 - (v - view.y) * view.scale;
  const corners = number => SPLIT[number % 4].map(k => cell[6 * (number >> 2) + k]);
  function shares(number, u, v) {
    const [a, b, c] = corners(number), ax = px(x[a]), ay = py(y[a]), bx = px(x[b]) - ax, by = py(y[b]) - ay, cx = px(x[c]) - ax, cy = py(y[c]) - ay;
    const area = bx * cy - by * cx, s = ((u - ax) * cy - (v - ay) * cx) / area, t = (bx * (v - ay) - by * (u - ax)) / area;
    return [1 - s - t, s, t];
  }
  function draw() {
    waiting = false;
    const w = canvas.width, h = canvas.height, field = fields[select.value], f = values[select.value];
    const image = pen.createImageData(w, h), out = new Uint32Array(image.data.buffer), palette = palettes[field.signed ? 1 : 0];
    const factor = 255 / ((field.high - field.low) || 1);
    under = new Int32Array(w * h).fill(-1);
    for (let number = 0; number < 4 * cells; number++) {
      const [a, b, c] = corners(number), ax = px(x[a]), ay = py(y[a]), bx = px(x[b]), by = py(y[b]), cx = px(x[c]), cy = py(y[c]);
      const r0 = Math.max(0, Math.ceil(Math.min(ay, by, cy) - 0.5)), r1 = Math.min(h - 1, Math.floor(Math.max(ay, by, cy) - 0.5));
      const c0 = Math.max(0, Math.ceil(Math.min(ax, bx, cx) - 0.5)), c1 = Math.min(w - 1, Math.floor(Math.max(ax, bx, cx) - 0.5));
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      if (!area) continue;
      for (let row = r0; row <= r1; row++) for (let col = c0; col <= c1; col++) {
        const u = col + 0.5 - ax, v = row + 0.5 - ay, s = (u * (cy - ay) - v * (cx - ax)) / area, t = ((bx - ax) * v - (by - ay) * u) / area;
        if (s < -1e-6 || t < -1e-6 || s + t > 1 + 1e-6) continue;
        const value = f[a] * (1 - s - t) + f[b] * s + f[c] * t;
        under[row * w + col] = number;
        out[row * w + col] = Number.isNaN(value) ? 0x40808080 : palette[Math.max(0, Math.min(255, Math.round((value - field.low) * factor)))];
      }
    }
    pen.putImageData(image, 0, 0);
    if (mesh.checked) {
      pen.strokeStyle = "rgba(90, 96, 102, 0.6)";
      pen.lineWidth = 0.6;
      pen.beginPath();
      for (let i = 0; i < cells; i++) [0, 3, 1, 4, 2, 5, 0].forEach((k, j) => { const n = cell[6 * i + k]; pen[j ? "lineTo" : "moveTo"](px(x[n]), py(y[n])); });
      pen.stroke();
    }
    const strip = bar.getContext("2d"), line = strip.createImageData(256, 1);
    new Uint32Array(line.data.buffer).set(palette);
    strip.putImageData(line, 0, 0);
    low.textContent = digits(field.low);
    high.textContent = `${digits(field.high)} ${field.unit}`;
    viewer.dataset.drawn = out.reduce((count, colour) => count + (colour ? 1 : 0), 0);
  }
  const later = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };
  const place = event => {
    const box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width;
    return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
  };
  function zoom(factor, u = canvas.width / 2, v = canvas.height / 2) {
    if (!factor) whole();
    else {
      const dx = (u - canvas.width / 2) / view.scale, dy = (canvas.height / 2 - v) / view.scale;
      view = { scale: view.scale * factor, x: view.x + dx * (1 - 1 / factor), y: view.y + dy * (1 - 1 / factor) };
    }
    later();
  }
  function tell(u, v) {
    const number = under[Math.floor(v) * canvas.width + Math.floor(u)] ?? -1;
    if (number < 0) { output.textContent = "Outside of the mesh."; return; }
    const part = shares(number, u, v), nodes3 = corners(number), at = list => nodes3.reduce((sum, n, k) => sum + part[k] * list[n], 0);
    const there = fields.map((field, i) => [field, at(values[i])]).filter(([, value]) => Number.isFinite(value));
    output.textContent = `x = ${digits(at(x))} m, y = ${digits(at(y))} m; ` + there.map(([field, value]) => `${field.name} ${digits(value)} ${field.unit}`).join(", ");
  }
  function fit() {
    const ratio = Math.min(2, window.devicePixelRatio || 1), width = Math.max(100, canvas.clientWidth);
    const height = Math.min(0.7 * window.innerHeight, Math.max(140, width * (top - bottom) / (right - left)));
    canvas.style.height = `${height}px`;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    whole();
    later();
  }
  let from = null;
  canvas.addEventListener("pointerdown", event => { from = place(event); canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("pointercancel", () => { from = null; });
  canvas.addEventListener("pointermove", event => {
    const to = place(event);
    if (from) {
      view = { ...view, x: view.x - (to[0] - from[0]) / view.scale, y: view.y + (to[1] - from[1]) / view.scale };
      from = to;
      later();
    }
    tell(...to);
  });
  canvas.addEventListener("wheel", event => { event.preventDefault(); zoom(Math.exp(-0.0015 * event.deltaY), ...place(event)); }, { passive: false });
  canvas.addEventListener("dblclick", () => zoom(0));
  canvas.addEventListener("keydown", event => {
    const step = 40 / view.scale, moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1.25 : 0.8);
    else if (moves[event.key]) { view = { ...view, x: view.x + moves[event.key][0], y: view.y + moves[event.key][1] }; later(); }
    else return;
    event.preventDefault();
  });
  for (const button of viewer.querySelectorAll("button")) button.addEventListener("click", () => zoom(+button.dataset.zoom));
  select.addEventListener("change", later);
  mesh.addEventListener("change", later);
  let before = 0;
  new ResizeObserver(() => { if (canvas.clientWidth !== before) { before = canvas.clientWidth; fit(); } }).observe(canvas);
}
for (const viewer of document.querySelectorAll(".viewer")) look(viewer).catch(error => { viewer.querySelector(".values").textContent = `This browser cannot show the fields: ${error.message}`; });
// On paper nothing stays folded.
let opened = [];
addEventListener("beforeprint", () => { opened = [...document.querySelectorAll("details:not([open])")]; opened.forEach(item => { item.open = true; }); });
addEventListener("afterprint", () => opened.forEach(item => { item.open = false; }));

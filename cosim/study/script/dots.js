// A panel of dots on a canvas, one per setup, with a brush and a cursor for the keyboard. All dots are drawn within one
// frame.

const MARGIN = { left: 78, right: 12, top: 26, bottom: 46 };
const ROOM = 0.03; // margin of the axis beyond the levels 0 and 1
const NEAR = 9; // largest distance between a click and its dot [px]
const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1] }; // axis, direction
const panels = [];
const color = {}; // colours of the style, see readColors

function readColors() {
  for (const name of ["ink", "soft", "grid", "grey", "edge", "paper", "accent", "hot", "tie"]) color[name] = tint(name);
}

/**
 * Make a panel.
 * @param place the element to draw in
 * @param view { arrays() -> [xs, ys] in levels, ranges(), describe(row), draw(pen, axes) }; called for every drawing
 */
function panelIn(place, view) {
  const canvas = document.createElement("canvas"), band = document.createElement("div"), tip = document.createElement("div");
  band.className = "band";
  tip.className = "tip";
  band.hidden = tip.hidden = true;
  place.replaceChildren(canvas, band, tip);
  const panel = { place, canvas, band, tip, view, near: false, cursor: null };
  listenPanel(panel);
  listenKeys(panel);
  panels.push(panel);
  watch.observe(place);
  return panel;
}

const watch = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    const panel = panels.find(({ place }) => place === target);
    if (!panel) continue;
    panel.near = isIntersecting;
    if (isIntersecting) drawPanel(panel);
  }
}, { rootMargin: "300px" });

function drawPanels(all = false) {
  for (const panel of panels) if (all || panel.near) drawPanel(panel);
}

function inside(panel) { // the plotting area [px]
  const { clientWidth, clientHeight } = panel.place;
  return { x: MARGIN.left, y: MARGIN.top, width: clientWidth - MARGIN.left - MARGIN.right,
    height: clientHeight - MARGIN.top - MARGIN.bottom };
}

/** Return the conversions from levels to pixels and back. */
function scales(panel) {
  const box = inside(panel), { x: [x0, x1], y: [y0, y1] } = panel.view.ranges();
  return {
    x: (value) => box.x + ((value - x0) / (x1 - x0)) * box.width,
    y: (value) => box.y + box.height - ((value - y0) / (y1 - y0)) * box.height,
    levelX: (pixel) => x0 + ((pixel - box.x) / box.width) * (x1 - x0),
    levelY: (pixel) => y0 + ((box.y + box.height - pixel) / box.height) * (y1 - y0),
  };
}

/** Return the pen of a canvas that fills its element, cleared, with one unit per pixel of the style. */
function penOf(place, canvas) {
  const sharp = Math.max(window.devicePixelRatio || 1, printing ? 2 : 1);
  const width = Math.round(place.clientWidth * sharp), height = Math.round(place.clientHeight * sharp);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.clearRect(0, 0, place.clientWidth, place.clientHeight);
  return pen;
}

function drawPanel(panel) {
  if (!panel.place.clientWidth) return;
  const pen = penOf(panel.place, panel.canvas), axes = { ...scales(panel), box: inside(panel) };
  panel.view.draw(pen, axes);
  if (panel.cursor === null) return;
  const [a, b] = pointOf(panel, panel.cursor);
  ring(pen, axes.x(a), axes.y(b), 10, color.accent, 2);
}

let printing = false;

function write(pen, text, x, y, { align = "center", ink = color.soft, font = "11px system-ui, sans-serif" } = {}) {
  pen.fillStyle = ink;
  pen.font = font;
  pen.textAlign = align;
  pen.textBaseline = "middle";
  pen.fillText(text, x, y);
}

/** Return a colour such as "#1f5f99" as a pixel of an image (little-endian RGBA). */
function pixelOf(text, opacity) {
  const [red, green, blue] = [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  return ((Math.round(255 * opacity) << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

/**
 * Draw a rectangle for every setup, those that are filtered out first. They are written into an image, so that a hundred
 * thousand setups are drawn in one frame.
 * @param half half the width and half the height of a rectangle [px]
 * @param inkOf (row, visible) -> its pixel; 0 draws nothing
 */
function drawDots(pen, [xs, ys], { x, y }, half, inkOf) {
  const { canvas } = pen, sharp = pen.getTransform().a, { width, height } = canvas;
  const image = new ImageData(width, height), pixels = new Uint32Array(image.data.buffer);
  const x0 = sharp * x(0), dx = sharp * x(1) - x0, y0 = sharp * y(0), dy = sharp * y(1) - y0;
  const wide = Math.max(1, Math.round(2 * sharp * half[0])), high = Math.max(1, Math.round(2 * sharp * half[1]));
  for (const visible of [0, 1]) {
    for (let row = 0; row < data.count; row++) {
      if (shown[row] !== visible) continue;
      const ink = inkOf(row, visible), left = Math.round(x0 + dx * xs[row] - wide / 2), top = Math.round(y0 + dy * ys[row] - high / 2);
      if (!ink || !(left >= 0 && top >= 0 && left + wide <= width && top + high <= height)) continue; // also without values
      for (let line = top * width + left; line < (top + high) * width; line += width) {
        for (let place = line; place < line + wide; place++) pixels[place] = ink;
      }
    }
  }
  const layer = new OffscreenCanvas(width, height);
  layer.getContext("2d").putImageData(image, 0, 0);
  pen.drawImage(layer, 0, 0, width / sharp, height / sharp);
}

const QUARTERS = [0, 0.25, 0.5, 0.75, 1];

/** Draw the horizontal axis: levels, and below them the values in the column's unit. */
function drawAxisX(pen, { x, box }, column) {
  for (const level of QUARTERS) {
    rule(pen, x(level), box.y, x(level), box.y + box.height, color.grid);
    const value = convert(column, column.low + level * (column.high - column.low));
    write(pen, `${100 * level} %`, x(level), box.y + box.height + 11, { ink: color.ink });
    write(pen, figure(value, 3), x(level), box.y + box.height + 24);
  }
  write(pen, column.name + inUnit(column), box.x + box.width / 2, box.y + box.height + 38, { ink: color.ink });
}

function drawAxisY(pen, { y, box }, column) {
  for (const level of QUARTERS) {
    rule(pen, box.x, y(level), box.x + box.width, y(level), color.grid);
    const value = convert(column, column.low + level * (column.high - column.low));
    write(pen, `${100 * level} %`, box.x - 6, y(level) - 6, { align: "right", ink: color.ink });
    write(pen, figure(value, 3), box.x - 6, y(level) + 7, { align: "right" });
  }
}

function rule(pen, x0, y0, x1, y1, ink, thick = 1) {
  pen.strokeStyle = ink;
  pen.lineWidth = thick;
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

function ring(pen, x, y, radius, ink, thick = 2) {
  pen.strokeStyle = ink;
  pen.lineWidth = thick;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.stroke();
}

function diamond(pen, x, y, radius) {
  pen.beginPath();
  pen.moveTo(x, y - radius);
  pen.lineTo(x + radius, y);
  pen.lineTo(x, y + radius);
  pen.lineTo(x - radius, y);
  pen.closePath();
  pen.fillStyle = color.paper;
  pen.fill();
  pen.strokeStyle = color.ink;
  pen.lineWidth = 2;
  pen.stroke();
}

/** Draw the markers of the picked setups, the baseline and the setup that was clicked. */
function drawMarks(pen, { x, y }, [xs, ys]) {
  const at = (row) => [x(xs[row]), y(ys[row])], known = (row) => row !== null && Number.isFinite(xs[row] + ys[row]);
  for (const row of state.picked) if (known(row)) ring(pen, ...at(row), 5, color.ink, 1.5);
  if (known(manifest.baseline)) diamond(pen, ...at(manifest.baseline), 6);
  if (known(state.current)) ring(pen, ...at(state.current), 8, color.hot, 2.5);
}

const pointOf = (panel, row) => panel.view.arrays().map((values) => values[row]);

function where(panel, event) {
  const frame = panel.place.getBoundingClientRect();
  return [event.clientX - frame.left, event.clientY - frame.top];
}

/** Return the setup whose dot is nearest to a pixel, with a preference for setups that pass the filters. */
function nearest(panel, [px, py]) {
  const { x, y } = scales(panel), [xs, ys] = panel.view.arrays();
  let best = null, shortest = Infinity;
  for (let row = 0; row < data.count; row++) {
    const distance = Math.hypot(x(xs[row]) - px, y(ys[row]) - py) + (shown[row] ? 0 : 0.5 * NEAR);
    if (distance < shortest) { shortest = distance; best = row; }
  }
  return shortest <= NEAR ? best : null;
}

function showBand(panel, start, end) {
  const [x0, x1] = [start[0], end[0]].sort((a, b) => a - b), [y0, y1] = [start[1], end[1]].sort((a, b) => a - b);
  Object.assign(panel.band.style, { left: `${x0}px`, top: `${y0}px`, width: `${x1 - x0}px`, height: `${y1 - y0}px` });
  panel.band.hidden = false;
  const { levelX, levelY } = scales(panel);
  state.brush = { arrays: panel.view.arrays(), from: [levelX(x0), levelY(y1)], to: [levelX(x1), levelY(y0)] };
  update();
}

function unbrush() {
  state.brush = null;
  state.spans.clear();
  for (const { band } of panels) band.hidden = true;
  update();
}

function listenPanel(panel) {
  let start = null;
  panel.place.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    start = where(panel, event);
    panel.place.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  panel.place.addEventListener("pointermove", (event) => {
    const here = where(panel, event);
    if (!start) return pointAt(panel, here);
    panel.tip.hidden = true;
    if (Math.hypot(here[0] - start[0], here[1] - start[1]) < 4 && panel.band.hidden) return;
    for (const other of panels) if (other !== panel) other.band.hidden = true;
    showBand(panel, start, here);
  });
  panel.place.addEventListener("pointerup", (event) => {
    const here = where(panel, event);
    if (start && Math.hypot(here[0] - start[0], here[1] - start[1]) < 4) {
      const row = nearest(panel, here);
      if (row !== null) choose(row);
    }
    start = null;
  });
  panel.place.addEventListener("pointerleave", () => { panel.tip.hidden = true; });
  panel.place.addEventListener("dblclick", unbrush);
}

/** Describe the setup under the pointer. */
function pointAt(panel, here) {
  const row = nearest(panel, here);
  panel.place.style.cursor = row === null ? "crosshair" : "pointer";
  if (row === null) panel.tip.hidden = true; else showTip(panel, row, here);
}

function showTip(panel, row, here) {
  panel.tip.hidden = false;
  panel.tip.textContent = panel.view.describe(row);
  const right = here[0] > panel.place.clientWidth / 2;
  Object.assign(panel.tip.style, { left: right ? "auto" : `${here[0] + 12}px`, top: `${here[1] + 12}px`,
    right: right ? `${panel.place.clientWidth - here[0] + 12}px` : "auto" });
}

/** Return the setup that follows another one along an axis, among those that pass the filters; itself at the end. */
function following(panel, row, axis, direction) {
  const values = panel.view.arrays()[axis], after = (a, b) => direction * (values[a] - values[b]) || a - b;
  let best = row;
  for (let other = 0; other < data.count; other++) {
    if (!shown[other] || !(after(other, row) > 0)) continue;
    if (best === row || after(other, best) < 0) best = other;
  }
  return best;
}

function listenKeys(panel) {
  panel.place.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && panel.cursor !== null) choose(panel.cursor);
    if (!(event.key in STEPS)) return;
    event.preventDefault();
    const start = panel.cursor ?? state.current ?? manifest.best;
    if (start === null) return;
    panel.cursor = panel.cursor === null ? start : following(panel, start, ...STEPS[event.key]);
    const { x, y } = scales(panel), [a, b] = pointOf(panel, panel.cursor);
    showTip(panel, panel.cursor, [x(a), y(b)]);
    document.getElementById("spoken").textContent = panel.tip.textContent;
    drawPanel(panel);
  });
  panel.place.addEventListener("blur", () => {
    panel.cursor = null;
    panel.tip.hidden = true;
    drawPanel(panel);
  });
}

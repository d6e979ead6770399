// A panel of dots on a canvas, one per setup, with a brush. All dots are drawn within one frame.

const MARGIN = { left: 78, right: 12, top: 26, bottom: 46 };
const GREY = "#d5dae1", INK = "#1c2430", SOFT = "#5b6675";
const ROOM = 0.03; // margin of the axis beyond the levels 0 and 1
const NEAR = 9; // largest distance between a click and its dot [px]
const panels = [];

/**
 * Make a panel.
 * @param place the element to draw in
 * @param view { point(row) -> [x, y] in levels, draw(pen, panel), title }; its functions are called for every drawing
 */
function panelIn(place, view) {
  const canvas = document.createElement("canvas"), band = document.createElement("div"), tip = document.createElement("div");
  band.className = "band";
  tip.className = "tip";
  band.hidden = tip.hidden = true;
  place.replaceChildren(canvas, band, tip);
  const panel = { place, canvas, band, tip, view, near: false };
  listenPanel(panel);
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

function drawPanel(panel) {
  const { place, canvas } = panel, sharp = Math.max(window.devicePixelRatio || 1, printing ? 2 : 1);
  if (!place.clientWidth) return;
  const width = Math.round(place.clientWidth * sharp), height = Math.round(place.clientHeight * sharp);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.clearRect(0, 0, place.clientWidth, place.clientHeight);
  panel.view.draw(pen, { ...scales(panel), box: inside(panel) });
}

let printing = false;

function write(pen, text, x, y, { align = "center", color = SOFT, font = "11px system-ui, sans-serif" } = {}) {
  pen.fillStyle = color;
  pen.font = font;
  pen.textAlign = align;
  pen.textBaseline = "middle";
  pen.fillText(text, x, y);
}

const QUARTERS = [0, 0.25, 0.5, 0.75, 1];

/** Draw the horizontal axis: levels, and below them the values in the column's unit. */
function drawAxisX(pen, { x, box }, column) {
  for (const level of QUARTERS) {
    rule(pen, x(level), box.y, x(level), box.y + box.height, "#e6e9ee");
    const value = convert(column, column.low + level * (column.high - column.low));
    write(pen, `${100 * level} %`, x(level), box.y + box.height + 11, { color: INK });
    write(pen, figure(value, 3), x(level), box.y + box.height + 24);
  }
  write(pen, column.name + inUnit(column), box.x + box.width / 2, box.y + box.height + 38, { color: INK });
}

function drawAxisY(pen, { y, box }, column) {
  for (const level of QUARTERS) {
    rule(pen, box.x, y(level), box.x + box.width, y(level), "#e6e9ee");
    const value = convert(column, column.low + level * (column.high - column.low));
    write(pen, `${100 * level} %`, box.x - 6, y(level) - 6, { align: "right", color: INK });
    write(pen, figure(value, 3), box.x - 6, y(level) + 7, { align: "right" });
  }
}

function rule(pen, x0, y0, x1, y1, color, thick = 1) {
  pen.strokeStyle = color;
  pen.lineWidth = thick;
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

function ring(pen, x, y, radius, color, thick = 2) {
  pen.strokeStyle = color;
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
  pen.fillStyle = "#fff";
  pen.fill();
  pen.strokeStyle = INK;
  pen.lineWidth = 2;
  pen.stroke();
}

/** Draw the markers of the picked setups, the baseline and the setup that was clicked. */
function drawMarks(pen, { x, y }, point) {
  const at = (row) => { const [a, b] = point(row); return [x(a), y(b)]; };
  for (const row of state.picked) if (known(point, row)) ring(pen, ...at(row), 5, INK, 1.5);
  if (manifest.baseline !== null && known(point, manifest.baseline)) diamond(pen, ...at(manifest.baseline), 6);
  if (state.current !== null && known(point, state.current)) ring(pen, ...at(state.current), 8, "#c0182b", 2.5);
}

const known = (point, row) => point(row).every(Number.isFinite);

function where(panel, event) {
  const frame = panel.place.getBoundingClientRect();
  return [event.clientX - frame.left, event.clientY - frame.top];
}

/** Return the setup whose dot is nearest to a pixel, with a preference for setups that pass the filters. */
function nearest(panel, [px, py]) {
  const { x, y } = scales(panel);
  let best = null, shortest = Infinity;
  for (let row = 0; row < data.count; row++) {
    const [a, b] = panel.view.point(row);
    const distance = Math.hypot(x(a) - px, y(b) - py) + (shown[row] ? 0 : 0.5 * NEAR);
    if (distance < shortest) { shortest = distance; best = row; }
  }
  return shortest <= NEAR ? best : null;
}

function showBand(panel, start, end) {
  const [x0, x1] = [start[0], end[0]].sort((a, b) => a - b), [y0, y1] = [start[1], end[1]].sort((a, b) => a - b);
  Object.assign(panel.band.style, { left: `${x0}px`, top: `${y0}px`, width: `${x1 - x0}px`, height: `${y1 - y0}px` });
  panel.band.hidden = false;
  const { levelX, levelY } = scales(panel);
  state.brush = { panel, point: panel.view.frozen(), from: [levelX(x0), levelY(y1)], to: [levelX(x1), levelY(y0)] };
  update();
}

function unbrush() {
  state.brush = null;
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
    if (!start) return point(panel, here);
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
function point(panel, here) {
  const row = nearest(panel, here);
  panel.place.style.cursor = row === null ? "crosshair" : "pointer";
  panel.tip.hidden = row === null;
  if (row === null) return;
  panel.tip.textContent = panel.view.describe(row);
  const right = here[0] > panel.place.clientWidth / 2;
  Object.assign(panel.tip.style, { left: right ? "auto" : `${here[0] + 12}px`, top: `${here[1] + 12}px`,
    right: right ? `${panel.place.clientWidth - here[0] + 12}px` : "auto" });
}

// Levels of one measure by the build at each corner (Figs 7.1, 7.3, 7.5), and trade-offs with other measures
// (Figs 7.2, 7.4, 7.6).

const focus = () => data.columns[state.focus];
const LEVEL_RANGE = [-ROOM, 1 + ROOM];

function describeSetup(row, columns) {
  const values = columns.map((column) => `${column.name} ${figure(convert(column, column.values[row]))} ${unit(column)}`);
  return [`setup ${data.numbers[row]}, rank ${manifest.failures[row] ? "–" : data.rank[row]}`,
    label(row).map((build, corner) => `${manifest.corners[corner].toUpperCase()} ${build}`).join("  "), ...values,
    remark(row)].filter(Boolean).join("\n");
}

// One lane per build, with the first build of the bank on top.
function trendView(corner) {
  const lanes = manifest.builds.length, lane = Float64Array.from(data.placed[corner], (build) => lanes - 1 - build);
  return {
    arrays: () => [focus().levels, lane],
    ranges: () => ({ x: LEVEL_RANGE, y: [-0.6, lanes - 0.4] }),
    describe: (row) => describeSetup(row, [focus()]),
    draw: (pen, axes) => drawTrend(pen, axes, corner, [focus().levels, lane]),
  };
}

function drawTrend(pen, axes, corner, arrays) {
  const { y, box } = axes, lanes = manifest.builds.length, half = Math.max(2, 0.36 * (box.height / lanes));
  write(pen, `${manifest.corners[corner].toUpperCase()} shock`, box.x, 12, { align: "left", ink: color.ink,
    font: "600 13px system-ui, sans-serif" });
  drawAxisX(pen, axes, focus());
  for (const [k, build] of manifest.builds.entries()) {
    const ink = state.off[corner].has(k) ? color.edge : color.ink;
    write(pen, build, box.x - 16, y(lanes - 1 - k), { align: "right", ink, font: "12px system-ui, sans-serif" });
    pen.fillStyle = manifest.colors[k];
    pen.fillRect(box.x - 12, y(lanes - 1 - k) - 5, 7, 10);
  }
  const inks = manifest.colors.map((one) => pixelOf(one, 0.6)), grey = pixelOf(color.grey, 0.5), tie = pixelOf(color.tie, 0.8);
  const tied = focus().uncertainty?.tied;
  if (tied) drawDots(pen, arrays, axes, [2.5, half + 2], (row, visible) => (visible && tied[row] ? tie : 0));
  drawDots(pen, arrays, axes, [0.75, half], (row, visible) => (visible ? inks[data.placed[corner][row]] : grey));
  drawMarks(pen, axes, arrays);
}

function tradeView(other) {
  const arrays = () => [focus().levels, data.columns[other].levels];
  return {
    arrays,
    ranges: () => ({ x: LEVEL_RANGE, y: LEVEL_RANGE }),
    describe: (row) => describeSetup(row, [focus(), data.columns[other]]),
    draw: (pen, axes) => drawTrade(pen, axes, data.columns[other], arrays()),
  };
}

function drawTrade(pen, axes, column, arrays) {
  const builds = data.placed[state.colored];
  write(pen, column.name + inUnit(column), 6, 12, { align: "left", ink: color.ink, font: "600 12px system-ui, sans-serif" });
  drawAxisX(pen, axes, focus());
  drawAxisY(pen, axes, column);
  const inks = manifest.colors.map((one) => pixelOf(one, 0.85)), grey = pixelOf(color.grey, 0.5);
  drawDots(pen, arrays, axes, [1.5, 1.5], (row, visible) => (visible ? inks[builds[row]] : grey));
  drawFront(pen, axes, front(focus(), column), arrays);
  drawSpread(pen, axes, column, arrays);
  drawMarks(pen, axes, arrays);
}

const cost = (column, row) => (column.better === "high" ? -column.values[row] : column.values[row]);

const fronts = new Map(); // Pareto fronts that were drawn, by pair of measures; cleared when the limits change

/** Return the rows of the Pareto front of two measures among the feasible setups. */
function front(first, second) {
  const key = `${first.at} ${second.at}`;
  if (!fronts.has(key)) fronts.set(key, frontOf(first, second));
  return fronts.get(key);
}

function frontOf(first, second) {
  const rows = [];
  for (let row = 0; row < data.count; row++) {
    if (data.allowed[row] && !manifest.failures[row] && isFinite(cost(first, row) + cost(second, row))) rows.push(row);
  }
  rows.sort((a, b) => cost(first, a) - cost(first, b) || cost(second, a) - cost(second, b));
  let lowest = Infinity;
  return rows.filter((row) => {
    if (cost(second, row) >= lowest) return false;
    lowest = cost(second, row);
    return true;
  });
}

function drawFront(pen, { x, y }, rows, [xs, ys]) {
  pen.strokeStyle = pen.fillStyle = color.ink;
  pen.lineWidth = 1.6;
  pen.beginPath();
  rows.forEach((row, k) => (k ? pen.lineTo(x(xs[row]), y(ys[row])) : pen.moveTo(x(xs[row]), y(ys[row]))));
  pen.stroke();
  for (const row of rows) { pen.beginPath(); pen.arc(x(xs[row]), y(ys[row]), 2.2, 0, 2 * Math.PI); pen.fill(); }
}

/** Draw the 95 % intervals of the setup that was clicked and of the picked ones. */
function drawSpread(pen, { x, y }, column, [xs, ys]) {
  const rows = new Set(state.picked);
  if (state.current !== null) rows.add(state.current);
  const ends = (one, row) => ["low", "high"].map((end) => (one.uncertainty[end][row] - one.low) / (one.high - one.low || 1));
  for (const row of rows) {
    const across = focus().uncertainty && ends(focus(), row), up = column.uncertainty && ends(column, row);
    if (across?.every(Number.isFinite)) rule(pen, x(across[0]), y(ys[row]), x(across[1]), y(ys[row]), color.ink, 1.2);
    if (up?.every(Number.isFinite)) rule(pen, x(xs[row]), y(up[0]), x(xs[row]), y(up[1]), color.ink, 1.2);
  }
}

function removePanels(place) {
  for (let k = panels.length - 1; k >= 0; k--) {
    if (!place.contains(panels[k].place)) continue;
    watch.unobserve(panels[k].place);
    panels.splice(k, 1);
  }
  place.replaceChildren();
}

function addElement(place, kind, name) {
  const one = document.createElement("div");
  one.className = kind;
  one.setAttribute("role", "img");
  one.setAttribute("aria-label", name);
  place.append(one);
  return one;
}

/** Add an element that the keyboard can reach, for a panel of dots. */
function addPanel(place, name, view) {
  const one = addElement(place, "panel", `${name}; the arrow keys step from setup to setup, Enter shows the setup`);
  one.setAttribute("role", "application");
  one.tabIndex = 0;
  panelIn(one, view);
}

function makeTrends() {
  const place = document.getElementById("trends");
  place.style.setProperty("--lanes", manifest.builds.length);
  for (const [corner, name] of manifest.corners.entries()) {
    addPanel(place, `levels by the build at ${name}`, trendView(corner));
  }
}

function makeTrades() {
  const place = document.getElementById("trades");
  removePanels(place);
  for (const box of document.querySelectorAll("#against input:checked")) {
    const other = Number(box.value);
    if (other !== state.focus) addPanel(place, `trade-off with ${data.columns[other].name}`, tradeView(other));
  }
}

function showTies() {
  const place = document.getElementById("ties"), { ties } = focus();
  place.hidden = ties === undefined;
  place.textContent = `${ties} ${ties === 1 ? "setup" : "setups"} (yellow): the smallest set that contains the best of this measure with a probability of 95 %.`;
}

function focusOn(column) {
  state.focus = column;
  document.getElementById("focus").value = column;
  for (const { band } of panels) band.hidden = true; // its setups stay selected
  showColumn(column, true);
  showTies();
  makeTrades();
  drawSensitivity();
  update();
}

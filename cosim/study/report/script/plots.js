// Levels of one measure by the build at each corner (Figs 7.1, 7.3, 7.5), and what they cost in the others
// (Figs 7.2, 7.4, 7.6).

const TRADES = 6; // panels of trade-offs at first
const focus = () => data.columns[state.focus];
const LEVEL_RANGE = [-ROOM, 1 + ROOM];

/** Rows in the order of drawing: those that are not shown first, so that the others lie on top. */
function eachDot(draw) {
  for (const wanted of [0, 1]) for (let row = 0; row < data.count; row++) if (shown[row] === wanted) draw(row, wanted);
}

function tellSetup(row, columns) {
  const values = columns.map((column) => `${column.name} ${figure(convert(column, column.values[row]))} ${unit(column)}`);
  return [`setup ${data.numbers[row]}, rank ${manifest.failures[row] ? "–" : data.rank[row]}`,
    label(row).map((build, corner) => `${manifest.corners[corner].toUpperCase()} ${build}`).join("  "), ...values,
    remark(row)].filter(Boolean).join("\n");
}

// A lane per build, the first of the bank on top.
function trendView(corner) {
  const lanes = manifest.builds.length;
  const pointOf = (column) => (row) => [column.levels[row], lanes - 1 - data.placed[corner][row]];
  return {
    point: (row) => pointOf(focus())(row),
    frozen: () => pointOf(focus()),
    ranges: () => ({ x: LEVEL_RANGE, y: [-0.6, lanes - 0.4] }),
    tell: (row) => tellSetup(row, [focus()]),
    draw: (pen, axes) => drawTrend(pen, axes, corner, pointOf(focus())),
  };
}

function drawTrend(pen, axes, corner, pointOf) {
  const { x, y, box } = axes, lanes = manifest.builds.length, half = Math.max(2, 0.36 * (box.height / lanes));
  write(pen, `${manifest.corners[corner].toUpperCase()} shock`, box.x, 12, { align: "left", color: INK,
    font: "600 13px system-ui, sans-serif" });
  drawAxisX(pen, axes, focus());
  for (const [k, build] of manifest.builds.entries()) {
    const color = state.off[corner].has(k) ? "#b9c1cb" : INK;
    write(pen, build, box.x - 16, y(lanes - 1 - k), { align: "right", color, font: "12px system-ui, sans-serif" });
    pen.fillStyle = manifest.colors[k];
    pen.fillRect(box.x - 12, y(lanes - 1 - k) - 5, 7, 10);
  }
  eachDot((row, wanted) => {
    const [level, lane] = pointOf(row);
    pen.globalAlpha = wanted ? 0.55 : 0.5;
    const near = wanted && focus().doubt?.tied[row];
    if (near) { pen.fillStyle = "#ffe27a"; pen.fillRect(x(level) - 2.5, y(lane) - half - 2, 5, 2 * half + 4); }
    pen.fillStyle = wanted ? manifest.colors[data.placed[corner][row]] : GREY;
    pen.fillRect(x(level) - 0.75, y(lane) - half, 1.5, 2 * half);
  });
  pen.globalAlpha = 1;
  drawMarks(pen, axes, pointOf);
}

function tradeView(other) {
  const pointOf = (column) => (row) => [column.levels[row], data.columns[other].levels[row]];
  return {
    point: (row) => pointOf(focus())(row),
    frozen: () => pointOf(focus()),
    ranges: () => ({ x: LEVEL_RANGE, y: LEVEL_RANGE }),
    tell: (row) => tellSetup(row, [focus(), data.columns[other]]),
    draw: (pen, axes) => drawTrade(pen, axes, data.columns[other], pointOf(focus())),
  };
}

function drawTrade(pen, axes, column, pointOf) {
  const { x, y } = axes, builds = data.placed[state.colored];
  write(pen, column.name + inUnit(column), 6, 12, { align: "left", color: INK, font: "600 12px system-ui, sans-serif" });
  drawAxisX(pen, axes, focus());
  drawAxisY(pen, axes, column);
  eachDot((row, wanted) => {
    const [a, b] = pointOf(row);
    pen.globalAlpha = wanted ? 0.8 : 0.5;
    pen.fillStyle = wanted ? manifest.colors[builds[row]] : GREY;
    pen.fillRect(x(a) - 1.5, y(b) - 1.5, 3, 3);
  });
  pen.globalAlpha = 1;
  drawFront(pen, axes, front(focus(), column).map(pointOf));
  drawSpread(pen, axes, column, pointOf);
  drawMarks(pen, axes, pointOf);
}

const wish = (column, row) => (column.better === "high" ? -column.values[row] : column.values[row]);

/** The setups that keep the constraints and that no other of them betters in one measure without losing in the other. */
function front(first, second) {
  const rows = [];
  for (let row = 0; row < data.count; row++) {
    if (data.allowed[row] && !manifest.failures[row] && isFinite(wish(first, row) + wish(second, row))) rows.push(row);
  }
  rows.sort((a, b) => wish(first, a) - wish(first, b) || wish(second, a) - wish(second, b));
  let least = Infinity;
  return rows.filter((row) => {
    if (wish(second, row) >= least) return false;
    least = wish(second, row);
    return true;
  });
}

function drawFront(pen, { x, y }, points) {
  pen.strokeStyle = INK;
  pen.lineWidth = 1.6;
  pen.beginPath();
  points.forEach(([a, b], k) => (k ? pen.lineTo(x(a), y(b)) : pen.moveTo(x(a), y(b))));
  pen.stroke();
  pen.fillStyle = INK;
  for (const [a, b] of points) { pen.beginPath(); pen.arc(x(a), y(b), 2.2, 0, 2 * Math.PI); pen.fill(); }
}

/** Two standard deviations about the setup that was clicked, and about those that are picked. */
function drawSpread(pen, { x, y }, column, pointOf) {
  const rows = new Set(state.picked);
  if (state.current !== null) rows.add(state.current);
  const half = (one, row) => (one.doubt?.spread[row] || 0) / (one.high - one.low || 1);
  for (const row of rows) {
    const [a, b] = pointOf(row), dx = half(focus(), row), dy = half(column, row);
    if (dx) rule(pen, x(a - dx), y(b), x(a + dx), y(b), INK, 1.2);
    if (dy) rule(pen, x(a), y(b - dy), x(a), y(b + dy), INK, 1.2);
  }
}

function drop(place) { // the panels of a place, before others take it
  for (let k = panels.length - 1; k >= 0; k--) {
    if (!place.contains(panels[k].place)) continue;
    watch.unobserve(panels[k].place);
    panels.splice(k, 1);
  }
  place.replaceChildren();
}

function made(place, kind, name) {
  const one = document.createElement("div");
  one.className = kind;
  one.setAttribute("role", "img");
  one.setAttribute("aria-label", name);
  place.append(one);
  return one;
}

function makeTrends() {
  const place = document.getElementById("trends");
  place.style.setProperty("--lanes", manifest.builds.length);
  for (const [corner, name] of manifest.corners.entries()) {
    panelIn(made(place, "panel", `levels by the build at ${name}`), trendView(corner));
  }
}

function makeTrades() {
  const place = document.getElementById("trades");
  drop(place);
  for (const box of document.querySelectorAll("#against input:checked")) {
    const other = Number(box.value);
    if (other !== state.focus) panelIn(made(place, "panel", `trade-off with ${data.columns[other].name}`), tradeView(other));
  }
}

function tellTies() {
  const place = document.getElementById("ties"), { ties } = focus();
  place.hidden = ties === undefined;
  place.textContent = `${ties} setups are not told from the best of this measure (yellow).`;
}

function focusOn(column) {
  state.focus = column;
  document.getElementById("focus").value = column;
  for (const { band } of panels) band.hidden = true; // the setups in it stay chosen
  showColumn(column, true);
  tellTies();
  makeTrades();
  drawSensitivity();
  update();
}

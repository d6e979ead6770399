// Parallel coordinates: one line per setup across the measures of the table. A range dragged on an axis is a filter.

const DRAWN_LINES = 2000; // of the setups that pass the filters, those of the best rank
const LIFT = { top: 58, bottom: 22, side: 60 };
let parallel = null; // { place, canvas, near }

const axesOf = () => tabled().map(([column, k]) => ({ column, k }));
const acrossOf = (k, count, width) => LIFT.side + (count > 1 ? (k * (width - 2 * LIFT.side)) / (count - 1) : 0);
/** Return the width of the words above an axis: those at the ends have the margin on both sides. */
const roomOf = (k, count, width) => Math.min(width / count, 2 * Math.min(acrossOf(k, count, width), width - acrossOf(k, count, width)));
const liftOf = (level, height) => LIFT.top + (1 - level) * (height - LIFT.top - LIFT.bottom);

function makeParallel() {
  const place = addElement(document.getElementById("parallel-place"), "panel",
    "parallel coordinates of the measures in the table; type limits under What if to filter with the keyboard");
  const canvas = document.createElement("canvas");
  place.append(canvas);
  parallel = { place, canvas, near: false };
  listenParallel();
  new IntersectionObserver(([{ isIntersecting }]) => { parallel.near = isIntersecting; drawParallel(); }, { rootMargin: "200px" }).observe(place);
}

/** Return the rows to draw: the best of those that pass the filters. */
function drawnRows() {
  const rows = [];
  for (const row of byRank()) if (shown[row] && !manifest.failures[row] && rows.push(row) === DRAWN_LINES) break;
  return rows;
}

function drawParallel(all = false) {
  if (!parallel || !(parallel.near || all) || !parallel.place.clientWidth) return;
  const { place, canvas } = parallel, pen = penOf(place, canvas), axes = axesOf();
  const { clientWidth: width, clientHeight: height } = place, rows = drawnRows();
  const trace = (row) => {
    pen.beginPath();
    axes.forEach(({ column }, k) => pen.lineTo(acrossOf(k, axes.length, width), liftOf(column.levels[row], height)));
    pen.stroke();
  };
  pen.globalAlpha = Math.max(0.08, Math.min(0.7, 120 / rows.length));
  pen.lineWidth = 1;
  for (const row of rows.reverse()) { pen.strokeStyle = manifest.colors[data.placed[state.colored][row]]; trace(row); }
  pen.globalAlpha = 1;
  axes.forEach((axis, k) => drawAxisOf(pen, axis, acrossOf(k, axes.length, width), roomOf(k, axes.length, width), height));
  for (const [row, ink, thick] of [[manifest.baseline, color.soft, 2], ...[...state.picked].map((one) => [one, color.ink, 1.5]), [state.current, color.hot, 2.5]]) {
    if (row === null || manifest.failures[row]) continue;
    Object.assign(pen, { strokeStyle: ink, lineWidth: thick });
    pen.setLineDash(row === manifest.baseline ? [6, 4] : []);
    trace(row);
  }
  pen.setLineDash([]);
  document.getElementById("parallel-count").textContent = rows.length < DRAWN_LINES ? "" : ` The ${DRAWN_LINES} best of those that pass the filters are drawn.`;
}

function drawAxisOf(pen, { column, k }, x, room, height) {
  rule(pen, x, LIFT.top, x, height - LIFT.bottom, color.ink, 1.2);
  const words = (column.name + inUnit(column)).split(" "), lines = [""];
  pen.font = "600 11px system-ui, sans-serif";
  for (const word of words) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (lines.at(-1) && pen.measureText(longer).width > room - 8) lines.push(word); else lines[lines.length - 1] = longer;
  }
  lines.slice(0, 3).forEach((line, n) => write(pen, line, x, 8 + 13 * n, { ink: color.ink, font: "600 11px system-ui, sans-serif" }));
  write(pen, figure(convert(column, column.high), 3), x, LIFT.top - 8);
  write(pen, figure(convert(column, column.low), 3), x, height - LIFT.bottom + 10);
  const span = state.spans.get(k);
  if (!span) return;
  const top = liftOf(span[1], height), bottom = liftOf(span[0], height);
  pen.globalAlpha = 0.35;
  pen.fillStyle = color.accent;
  pen.fillRect(x - 7, top, 14, bottom - top);
  pen.globalAlpha = 1;
}

function listenParallel() {
  const { place } = parallel;
  let start = null;
  const levelAt = ([, y]) => Math.min(1, Math.max(0, 1 - (y - LIFT.top) / (place.clientHeight - LIFT.top - LIFT.bottom)));
  const axisAt = ([x]) => {
    const axes = axesOf(), distance = (k) => Math.abs(acrossOf(k, axes.length, place.clientWidth) - x);
    return axes.map((axis, k) => [distance(k), axis.k]).sort((a, b) => a[0] - b[0])[0]?.[1];
  };
  place.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    const here = where(parallel, event);
    start = { here, axis: axisAt(here) };
    place.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  place.addEventListener("pointermove", (event) => {
    const here = where(parallel, event);
    if (!start || Math.abs(here[1] - start.here[1]) < 4) return;
    state.spans.set(start.axis, [levelAt(start.here), levelAt(here)].sort((a, b) => a - b));
    update();
  });
  place.addEventListener("pointerup", (event) => {
    if (start && Math.abs(where(parallel, event)[1] - start.here[1]) < 4) { state.spans.delete(start.axis); update(); }
    start = null;
  });
}

// Setups side by side: the picked ones, the one shown and the baseline, with measures, shock curves, spectra and traces.

const MOST_COMPARED = 6;
const comparisonPlace = document.getElementById("comparison");
let comparisonIsNear = false;

new IntersectionObserver(([{ isIntersecting }]) => {
  comparisonIsNear = isIntersecting;
  drawComparison();
}, { rootMargin: "300px" }).observe(comparisonPlace);

/** Return the rows that are compared: the picked ones in the order of their rank, the setup shown, the baseline. */
function comparedRows() {
  const picked = [...state.picked].sort((a, b) => data.rank[a] - data.rank[b]);
  const rows = [state.current, manifest.baseline, ...picked].filter((row) => row !== null && !manifest.failures[row]);
  return [...new Set(rows)].slice(0, MOST_COMPARED);
}

const inkOf = (k) => LINES[k % LINES.length];
const nameOf = (row) => `setup ${data.numbers[row]}${row === manifest.baseline ? " (baseline)" : ""}`;
let comparisonOf = ""; // what was drawn last

async function drawComparison() {
  const rows = comparedRows(), wanted = JSON.stringify([rows, metric, color.paper]);
  if (!(comparisonIsNear || comparisonOf) || wanted === comparisonOf) return;
  comparisonOf = wanted;
  document.getElementById("too-many").hidden = state.picked.size + 2 <= MOST_COMPARED;
  fillComparison(rows);
  await loadPlotly();
  drawCurves(rows);
  drawChannel(rows);
}

/** Draw spectra and traces of the chosen channel. */
function drawChannel(rows) {
  drawSpectra(rows);
  drawTracesTogether(rows);
}

function fillComparison(rows) {
  const table = document.getElementById("side-by-side");
  table.tHead.replaceChildren();
  table.tBodies[0].replaceChildren();
  const head = table.tHead.insertRow();
  const heading = (text, kind) => { const one = document.createElement("th"); one.textContent = text; one.className = kind; head.append(one); return one; };
  heading("", "");
  rows.forEach((row, k) => { heading(nameOf(row), "number").style.color = inkOf(k); });
  for (const [corner, name] of manifest.corners.entries()) {
    const line = table.tBodies[0].insertRow();
    cell(line, name.toUpperCase(), "name");
    for (const row of rows) buildCell(line, data.placed[corner][row]);
  }
  for (const column of data.columns) {
    const line = table.tBodies[0].insertRow(), values = rows.map((row) => column.values[row]);
    const least = Math.min(...values);
    cell(line, column.name + inUnit(column), "name");
    for (const value of values) cell(line, figure(convert(column, value)), value === least ? "number least" : "number");
  }
}

function buildCell(line, build) {
  const name = manifest.builds[build], page = manifest.pages[name], one = cell(line, page ? "" : name, "number");
  if (!page) return;
  const link = document.createElement("a");
  Object.assign(link, { href: page, textContent: name, title: `page of the shock ${name}` });
  one.append(link);
}

/** Draw the forces of the shocks at each corner over constant velocity. */
function drawCurves(rows) {
  const place = document.getElementById("curves"), known = Object.keys(manifest.curves).length > 0;
  place.hidden = !known;
  document.getElementById("no-curves").hidden = known;
  if (!known) return;
  const lines = manifest.corners.flatMap((_, corner) => rows.map((row, k) => {
    const curve = manifest.curves[manifest.builds[data.placed[corner][row]]], axis = corner ? corner + 1 : "";
    if (!curve) return null;
    const values = (at) => Array.from(new Float64Array(data.bytes, at, curve.count));
    return { type: "scatter", mode: "lines", name: nameOf(row), legendgroup: nameOf(row), showlegend: corner === 0, xaxis: `x${axis}`, yaxis: `y${axis}`,
      x: values(curve.velocity).map((v) => convert(manifest.velocity, v)), y: values(curve.force).map((f) => convert(manifest.force, f)),
      line: { color: inkOf(k), width: 1.6, dash: row === manifest.baseline ? "dash" : "solid" } };
  })).filter(Boolean);
  const annotations = manifest.corners.map((name, corner) => ({ text: `<b>${plain(name.toUpperCase())}</b>`, showarrow: false, xanchor: "left",
    xref: `x${corner ? corner + 1 : ""} domain`, yref: `y${corner ? corner + 1 : ""} domain`, x: 0.02, y: 1.0 }));
  const columns = place.clientWidth < 700 ? Math.min(2, manifest.corners.length) : manifest.corners.length, stacked = Math.ceil(manifest.corners.length / columns);
  const layout = { ...PAPER, height: 100 + 230 * stacked, margin: { l: 62, r: 10, t: 46, b: 46 }, legend: { orientation: "h", y: 1 + 0.16 / stacked }, annotations,
    grid: { rows: stacked, columns, pattern: "independent", xgap: 0.16, ygap: 0.3 } };
  manifest.corners.forEach((_, corner) => {
    const n = corner ? corner + 1 : "";
    layout[`xaxis${n}`] = { ...AXIS, title: { text: `velocity${inUnit(manifest.velocity)}`, font: { size: 11 } } };
    layout[`yaxis${n}`] = { ...AXIS, title: { text: corner % columns ? "" : `force${inUnit(manifest.force)}`, font: { size: 11 } } };
  });
  Plotly.react(place, lines, layout, PLOT);
}

/** Draw the amplitude spectral densities of one channel, for the setups with traces. */
function drawSpectra(rows) {
  const choice = document.getElementById("spectrum"), place = document.getElementById("spectra");
  const with_ = rows.filter((row) => manifest.spectra[data.numbers[row]]);
  document.getElementById("spectra-place").hidden = !with_.length;
  if (!with_.length) return;
  const channels = manifest.spectra[data.numbers[with_[0]]].channels;
  if (!choice.options.length) choice.replaceChildren(...channels.map(({ name }) => new Option(name, name)));
  const lines = with_.map((row) => {
    const found = manifest.spectra[data.numbers[row]], channel = found.channels.find(({ name }) => name === choice.value), k = rows.indexOf(row);
    if (!channel) return null;
    const values = (at) => Array.from(new Float32Array(data.bytes, at, found.count));
    return { type: "scatter", mode: "lines", name: nameOf(row), x: values(found.at), y: values(channel.at).map((one) => width(channel, one)),
      line: { color: inkOf(k), width: 1.4, dash: row === manifest.baseline ? "dash" : "solid" } };
  }).filter(Boolean);
  const shownAs = channels.find(({ name }) => name === choice.value);
  Plotly.react(place, lines, { ...PAPER, height: 300, margin: { l: 70, r: 10, t: 10, b: 46 }, showlegend: true, legend: { orientation: "h", y: 1.1 },
    xaxis: { ...AXIS, type: "log", title: { text: "frequency [Hz]", font: { size: 12 } } },
    yaxis: { ...AXIS, type: "log", exponentformat: "power", title: { text: `amplitude density [${unit(shownAs) || "1"}/√Hz]`, font: { size: 12 } } } }, PLOT);
}

/** Draw the traces of the same channel, in the seconds that the traces of the setup show. */
function drawTracesTogether(rows) {
  const chosen = document.getElementById("spectrum").value, place = document.getElementById("traces-together");
  const with_ = rows.filter((row) => traceOf(row)?.channels.some(({ name }) => name === chosen));
  if (!with_.length) return;
  const first = traceOf(with_[0]), middle = 0.5 * (first.from + first.to), shownAs = first.channels.find(({ name }) => name === chosen);
  const lines = with_.map((row) => {
    const trace = traceOf(row), channel = trace.channels.find(({ name }) => name === chosen);
    const line = lineOf(trace, channel, wholeOf(trace), inkOf(rows.indexOf(row)), row === manifest.baseline ? "dash" : "");
    return { ...line, name: nameOf(row), showlegend: true };
  });
  Plotly.react(place, lines, { ...PAPER, height: 300, margin: { l: 70, r: 10, t: 10, b: 46 }, hovermode: "x unified", legend: { orientation: "h", y: 1.1 },
    xaxis: { ...AXIS, range: [Math.max(first.from, middle - 2), Math.min(first.to, middle + 2)], title: { text: "time [s]", font: { size: 12 } } },
    yaxis: { ...AXIS, title: { text: `${plain(chosen)}${inUnit(shownAs)}`, font: { size: 12 } } } }, PLOT);
}

// One setup: its builds, its values compared with the baseline and the best setup, its time traces.

const PLOT = { ...SETTINGS, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage"] };
const LINES = ["#0072b2", "#d55e00", "#009e73", "#8e5a9b", "#56b4e9", "#e69f00", "#4d4d4d", "#a6374f"];
const DRAWN = 700; // pairs of points (minimum, maximum) drawn per line

function cornersOf(row) {
  const place = document.createElement("div");
  place.className = "car";
  label(row).forEach((build, corner) => {
    const tile = document.createElement("div");
    tile.style.setProperty("--build", manifest.colors[data.placed[corner][row]]);
    tile.innerHTML = "<b></b><span></span>";
    tile.firstChild.textContent = manifest.corners[corner].toUpperCase();
    tile.lastChild.textContent = build;
    place.append(tile);
  });
  return place;
}

function standing(row) {
  const number = data.numbers[row];
  if (manifest.failures[row]) return `Setup ${number} failed: ${manifest.failures[row]}`;
  const place = `Setup ${number} has rank ${data.rank[row]} of ${manifest.done}`;
  const limits = data.allowed[row] ? "" : "; it breaks a constraint";
  const error = Number.isFinite(data.error[row]) ? ` Coupling error ${figure(data.error[row], 2)} %.` : "";
  return `${place}${limits}.${manifest.marks[row] ? ` Marked: ${manifest.marks[row]}.` : ""}${error}`;
}

/** Change from another setup in percent. */
function change(column, row, other) {
  if (other === null) return "";
  if (other === row) return "(this setup)";
  const base = column.values[other], part = (column.values[row] - base) / Math.abs(base);
  if (!Number.isFinite(part)) return "";
  return `${part > 0 ? "+" : ""}${percent(part, 2)}`;
}

function compared(row) {
  const body = document.getElementById("compared").tBodies[0];
  body.replaceChildren();
  for (const column of data.columns) {
    const line = body.insertRow();
    cell(line, column.name, "name");
    cell(line, unit(column), "");
    cell(line, figure(convert(column, column.values[row])) + spreadOf(column, row), "number");
    cell(line, "", "bar-cell").innerHTML = `<span class="bar"><span style="width:${100 * (column.levels[row] || 0)}%"></span></span>`;
    cell(line, percent(column.levels[row]), "number");
    cell(line, change(column, row, manifest.baseline), "number");
    cell(line, change(column, row, manifest.best), "number");
  }
}

function drawSetup() {
  const row = state.current;
  document.getElementById("setup-empty").hidden = row !== null;
  document.getElementById("setup-card").hidden = row === null;
  if (row === null) return;
  document.getElementById("standing").textContent = standing(row);
  document.getElementById("corners").replaceChildren(cornersOf(row));
  const box = document.getElementById("pick-current");
  box.checked = state.picked.has(row);
  compared(row);
  drawTraces(row);
}

const traceOf = (row) => (row === null ? undefined : manifest.traces[data.numbers[row]]);

function drawTraces(row) {
  const trace = traceOf(row), command = document.getElementById("no-traces");
  const place = document.getElementById("traces");
  command.hidden = Boolean(trace);
  document.getElementById("has-traces").hidden = !trace;
  place.replaceChildren();
  const text = manifest.trace_command.replace("{setup}", data.numbers[row]);
  document.getElementById("command").textContent = text;
  document.getElementById("command-place").hidden = !text;
  if (!trace) return;
  document.getElementById("thinned").textContent = trace.samples === 1 ? "The traces contain every sample."
    : `The traces contain the minimum and maximum of every ${trace.samples} samples (${figure(1e3 * trace.interval, 3)} ms), so that no peak is lost.`;
  for (const quantity of [...new Set(trace.channels.map((channel) => channel.quantity))]) {
    const one = addElement(place, "trace", `${quantity} of setup ${data.numbers[row]}`);
    one.quantity = quantity;
    traceWatch.observe(one);
  }
}

const traceWatch = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) if (isIntersecting) drawTrace(target);
}, { rootMargin: "300px" });

function lineOf(trace, channel, span, color, dash) {
  const time = new Float64Array(data.bytes, trace.at, trace.count), values = samplesOf(channel, data.bytes, trace.count);
  const first = time.findIndex((moment) => moment >= span[0]), after = time.findIndex((moment) => moment > span[1]);
  const last = after < 0 ? time.length : after;
  const name = plain(channel.name.replace(/\.[^.]*$/, "")) + (dash ? ", baseline" : "");
  const kept = decimated(values, first, last, DRAWN);
  return { type: "scatter", mode: "lines", name, showlegend: !dash, x: kept.map((k) => time[k]),
    y: kept.map((k) => convert(channel, values[k])), line: { color, width: dash ? 1 : 1.4, dash: dash || "solid" }, hovertemplate: `%{y:.4~g} ${unit(channel)}` };
}

const wholeOf = (trace) => [trace.from, trace.to];
const withBaseline = () => document.getElementById("with-baseline").checked;

async function drawTrace(place) {
  await loadPlotly();
  if (!place.isConnected) return;
  const trace = traceOf(state.current), other = withBaseline() && state.current !== manifest.baseline ? traceOf(manifest.baseline) : null;
  if (!trace) return;
  const middle = 0.5 * (trace.from + trace.to);
  const span = state.span || [Math.max(trace.from, middle - 2), Math.min(trace.to, middle + 2)];
  const channels = trace.channels.filter((channel) => channel.quantity === place.quantity);
  const twin = (channel) => other && other.channels.find(({ name }) => name === channel.name);
  const lines = channels.flatMap((channel, k) => [
    ...(twin(channel) ? [lineOf(other, twin(channel), span, `${LINES[k % LINES.length]}80`, "dot")] : []),
    lineOf(trace, channel, span, LINES[k % LINES.length], "")]);
  const layout = { ...PAPER, margin: { l: 64, r: 10, t: 24, b: 38 }, height: 230, hovermode: "x unified", dragmode: "zoom",
    legend: { font: { size: 11 } }, hoverlabel: { namelength: 40, font: { size: 11 } },
    xaxis: { ...AXIS, range: span, title: { text: "time [s]", font: { size: 12 }, standoff: 4 } },
    yaxis: { ...AXIS, fixedrange: true, title: { text: `${plain(place.quantity)}${inUnit(channels[0])}`, font: { size: 12 } } } };
  Plotly.react(place, lines, layout, PLOT);
  if (place.listens) return;
  place.listens = true;
  place.on("plotly_relayout", (changed) => {
    if ("xaxis.range[0]" in changed) zoomTraces([changed["xaxis.range[0]"], changed["xaxis.range[1]"]]);
    else if (changed["xaxis.autorange"]) zoomTraces(wholeOf(traceOf(state.current)));
  });
}

function zoomTraces(span) {
  state.span = span;
  for (const place of document.querySelectorAll("#traces .trace")) if (place.listens) drawTrace(place);
}

function redrawTraces() {
  for (const place of document.querySelectorAll("#traces .trace")) if (place.listens) drawTrace(place);
}

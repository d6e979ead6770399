// Traces and spectra of the channels, in panels.

const COLUMNS = 900; // pairs of points per plot: about one per pixel
const OPTIONS = { ...SETTINGS, responsive: true, doubleClick: false, modeBarButtonsToRemove: [...SETTINGS.modeBarButtonsToRemove, "toImage"] };
const OCTAVES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
const state = { from: 0, to: 1 };

const manifest = JSON.parse(document.getElementById("manifest").textContent);
let numbers, time, frequency;

const samples = (channel) => (channel.samples ??= samplesOf(channel, numbers, time.length));

function firstAt(moment) { // return the index of the first sample at or after a time
  let low = 0, high = time.length;
  while (low < high) {
    const half = (low + high) >> 1;
    if (time[half] < moment) low = half + 1; else high = half;
  }
  return low;
}

const chosen = (panel) => [...panel.querySelectorAll(".chips input:checked")].map(
  (box) => ({ ...box.dataset, channel: manifest.channels[Number(box.dataset.row)] }));
const unit = (scale) => (metric ? scale.si : scale.unit);
const squared = (scale) => scale.squared[metric ? 1 : 0] + "/Hz";
const shown = (scale, value) => (metric ? value : scale.factor * value + scale.offset);
const hover = (here) => `%{y:.4~g} ${here}`;
const title = (text) => ({ text, font: { size: 12 }, standoff: 6 });

function layout(x, y) {
  return { ...PAPER, margin: { l: 64, r: 14, t: 26, b: 42 }, showlegend: false, hovermode: "x unified", dragmode: "zoom",
    hoverlabel: { font: { size: 11 }, bgcolor: "rgba(255,255,255,0.94)", namelength: 48 },
    modebar: { ...PAPER.modebar, orientation: "h" },
    xaxis: { ...AXIS, ...x }, yaxis: { ...AXIS, ...y } };
}

function line(entry, x, y, template) {
  return { type: "scatter", mode: "lines", name: plain(entry.channel.name), x, y,
    line: { color: entry.color, dash: entry.dash, width: 1.3 }, hovertemplate: template };
}

const nothing = { text: "no channel is selected", xref: "paper", yref: "paper", x: 0.5, y: 0.5, showarrow: false };

function drawTraces(panel) {
  const place = panel.querySelector(".time-plot"), margin = 0.5 * (state.to - state.from);
  const a = Math.max(0, firstAt(state.from - margin) - 1), b = Math.min(time.length, firstAt(state.to + margin) + 1);
  let least = Infinity, greatest = -Infinity, scale = null;
  const lines = chosen(panel).map((entry) => {
    const values = samples(entry.channel), kept = decimated(values, a, b, COLUMNS);
    scale = entry.channel.scale;
    const x = kept.map((k) => time[k]), y = kept.map((k) => shown(scale, values[k]));
    for (let k = 0; k < x.length; k++) {
      if (x[k] < state.from || x[k] > state.to) continue;
      least = Math.min(least, y[k]);
      greatest = Math.max(greatest, y[k]);
    }
    return line(entry, x, y, hover(unit(scale)));
  });
  const room = 0.06 * (greatest - least) || Math.abs(greatest) * 0.05 || 1;
  const range = Number.isFinite(room) && greatest >= least ? [least - room, greatest + room] : [-1, 1];
  const traces = layout(
    { range: [state.from, state.to], title: title("time [s]"), unifiedhovertitle: { text: "%{x:.4f} s" } },
    { range, fixedrange: true, title: title(scale ? unit(scale) : "") });
  if (manifest.settling > 0) traces.shapes = [{ type: "rect", yref: "paper", x0: time[0], x1: manifest.settling,
    y0: 0, y1: 1, fillcolor: "#eceff3", line: { width: 0 }, layer: "below" }];
  if (!lines.length) traces.annotations = [nothing];
  Plotly.react(place, lines, traces, OPTIONS);
  if (!place.watched) {
    place.watched = true;
    place.on("plotly_relayout", (change) => {
      if ("xaxis.range[0]" in change) show(change["xaxis.range[0]"], change["xaxis.range[1]"]);
    });
    place.on("plotly_doubleclick", () => show(time[0], time[time.length - 1]));
  }
}

function drawSpectra(panel) {
  const place = panel.querySelector(".frequency-plot");
  if (!place) return;
  let scale = null;
  const lines = chosen(panel).map((entry) => {
    scale = entry.channel.scale;
    const square = metric ? 1 : scale.factor * scale.factor;
    const density = new Float32Array(numbers, entry.channel.density, frequency.length);
    return line(entry, frequency, Float64Array.from(density, (d) => d * square), hover(squared(scale)));
  });
  const top = Math.log10(Math.min(50, frequency[frequency.length - 1])), bottom = Math.log10(frequency[0]);
  const spectrum = layout(
    { type: "log", range: [bottom, Math.max(top, bottom + 0.1)], title: title("frequency [Hz]"), tickvals: OCTAVES,
      ticktext: OCTAVES.map(String), unifiedhovertitle: { text: "%{x:.4~g} Hz" } },
    { type: "log", title: title(scale ? squared(scale) : ""), exponentformat: "power", tickfont: { size: 10 },
      ...decades(lines, top) });
  Plotly.react(place, lines, spectrum, OPTIONS);
  if (!place.watched) {
    place.watched = true;
    place.on("plotly_doubleclick", () => drawSpectra(panel));
  }
}

function decades(lines, top) { // return the range for the visible frequencies, at most six decades
  let least = Infinity, greatest = 0;
  for (const { y } of lines) for (let k = 0; k < y.length && Math.log10(frequency[k]) <= top; k++) {
    if (y[k] > 0) least = Math.min(least, y[k]);
    greatest = Math.max(greatest, y[k]);
  }
  if (!(greatest > 0)) return {};
  const high = Math.log10(greatest) + 0.2;
  const low = Math.max(Math.log10(least) - 0.2, high - 6);
  return { range: [low, high], dtick: high - low > 1.5 ? 1 : "D2" };
}

const panels = [...document.querySelectorAll(".panel")];
const whole = () => [time[0], time[time.length - 1]];

/** Draw a panel when it is open and near the window; until then remember that it is to be drawn. */
function draw(panel) {
  panel.late = !(panel.open && panel.near);
  if (panel.late) return;
  drawTraces(panel);
  drawSpectra(panel);
}

function show(from, to) {
  const [first, last] = whole(), span = Math.min(Math.max(to - from, 1e-6), last - first) || 1;
  state.from = Math.min(Math.max(from, first), Math.max(first, last - span));
  state.to = state.from + span;
  document.getElementById("shown").textContent = `${state.from.toFixed(2)} to ${state.to.toFixed(2)} s`;
  for (const button of document.querySelectorAll("[data-span]")) {
    const wide = button.dataset.span === "all" ? last - first : Number(button.dataset.span);
    button.setAttribute("aria-pressed", String(Math.abs(wide - span) < 1e-6));
  }
  for (const panel of panels) if (panel.open && panel.near && !panel.late) drawTraces(panel); else draw(panel);
}

function move(event) {
  const { span, move: way } = event.target.dataset;
  const middle = 0.5 * (state.from + state.to), step = 0.8 * (state.to - state.from) * Number(way);
  if (span === "all") show(...whole());
  else if (span) show(middle - 0.5 * Number(span), middle + 0.5 * Number(span));
  else if (way) show(state.from + step, state.to + step);
}

/** Draw the first so many of the channels that are listed, and no others. */
function choose(panel, count) {
  const labels = [...panel.querySelectorAll(".chips label")];
  const wanted = new Set(labels.filter((label) => !label.hidden).slice(0, count));
  for (const label of labels) label.querySelector("input").checked = wanted.has(label);
  draw(panel);
}

function find(event) {
  const words = event.target.value.toLowerCase().split(/\s+/);
  const fits = (text) => words.every((word) => text.toLowerCase().includes(word));
  for (const panel of panels) {
    const labels = [...panel.querySelectorAll(".chips label")];
    for (const label of labels) label.hidden = !fits(label.textContent);
    panel.hidden = labels.every((label) => label.hidden);
  }
  for (const row of document.querySelectorAll("#statistics tbody tr")) row.hidden = !fits(row.cells[0].textContent);
}

function listen() {
  document.getElementById("windows").addEventListener("click", move);
  for (const button of document.querySelectorAll("[data-span]")) {
    button.hidden = Number(button.dataset.span) >= time[time.length - 1] - time[0];
  }
  document.getElementById("find").addEventListener("input", find);
  for (const panel of panels) {
    panel.addEventListener("toggle", () => draw(panel));
    panel.querySelector(".chips").addEventListener("change", () => draw(panel));
    panel.querySelector(".chips").addEventListener("click", (event) => {
      if (event.target.dataset.choose) choose(panel, Number(event.target.dataset.choose));
    });
  }
  const watch = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
    target.near = isIntersecting;
    if (isIntersecting && target.late) draw(target);
  }), { rootMargin: "600px" });
  panels.forEach((panel) => watch.observe(panel));
  window.addEventListener("beforeprint", () => panels.forEach((panel) => {
    panel.near = true;
    if (panel.late) draw(panel);
  }));
}

onUnits(() => panels.forEach(draw));
if (!panels.length) return;
try {
  await loadPlotly();
  numbers = await unpacked("numbers");
  time = new Float64Array(numbers, manifest.time.at, manifest.time.count);
  if (manifest.frequency) frequency = new Float64Array(numbers, manifest.frequency.at, manifest.frequency.count);
  const [first, last] = whole(), middle = 0.5 * (first + last);
  if (last - first > 8) show(middle - 2, middle + 2); else show(first, last);
  listen();
} catch (error) {
  fail("The plots", error);
}

// Every page: its data, the plotting library, the units.

/** Return a colour of the style, such as "paper" or "ink"; a style may be dark on a screen and light in print. */
const tint = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const AXIS = { get gridcolor() { return tint("grid"); }, zeroline: false, get linecolor() { return tint("edge"); }, ticks: "outside",
  get tickcolor() { return tint("edge"); } };
const PAPER = { get font() { return { family: "system-ui, sans-serif", size: 12, color: tint("ink") }; },
  get paper_bgcolor() { return tint("paper"); }, get plot_bgcolor() { return tint("paper"); }, modebar: { bgcolor: "rgba(0,0,0,0)" } };
const SETTINGS = { displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
const LEVELS = 65535; // see eightpost/report/page.py
let metric = document.body.classList.contains("metric"); // whether values are shown in SI units

/** Return a text in which plotly finds no markup. */
const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

/** Return the bytes of a script element that are compressed with gzip and encoded in base64. */
async function unpacked(id) {
  const letters = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

const textOf = async (id) => new TextDecoder().decode(await unpacked(id));

let plotlyIsLoading = null;

/** Load the plotting library, once. */
function loadPlotly() {
  plotlyIsLoading ??= textOf("plotly").then((text) => {
    const script = document.createElement("script");
    script.textContent = text;
    document.head.append(script);
  });
  return plotlyIsLoading;
}

/** Return the samples of a channel in SI; `bytes` has them as 16-bit differences of levels. */
function samplesOf(channel, bytes, count) {
  const steps = new Uint16Array(bytes, channel.at, count), values = new Float64Array(count);
  for (let k = 0, level = 0; k < count; k++) {
    level = (level + steps[k]) & LEVELS;
    values[k] = channel.low + (channel.high - channel.low) * (level / LEVELS);
  }
  return values;
}

/** Return the indices of the samples to draw from `first` to `last`: all, or the minimum and maximum of each column. */
function decimated(values, first, last, columns) {
  const kept = [], width = Math.max(1, Math.ceil((last - first) / columns));
  for (let start = first; start < last; start += width) {
    let lowest = start, highest = start;
    for (let k = start; k < Math.min(last, start + width); k++) {
      if (values[k] < values[lowest]) lowest = k;
      if (values[k] > values[highest]) highest = k;
    }
    kept.push(Math.min(lowest, highest));
    if (lowest !== highest) kept.push(Math.max(lowest, highest));
  }
  return kept;
}

/** Switch tables and plots when the reader chooses units; `redraw` draws what the style does not switch. */
function onUnits(redraw) {
  for (const box of document.querySelectorAll("input[name=units]")) {
    box.checked = box.defaultChecked; // a browser keeps the old choice when it reloads the page
    box.addEventListener("change", () => {
      metric = box.value === "si";
      document.body.classList.toggle("metric", metric);
      redraw();
    });
  }
}

/** Unfold a section that the reader goes to. */
document.querySelector("nav").addEventListener("click", ({ target }) => {
  const folded = target.hash && document.querySelector(`${target.hash} > details`);
  if (folded) folded.open = true;
});

function fail(what, error) {
  const trouble = document.getElementById("trouble");
  trouble.textContent = `${what} cannot be drawn (${error}). This page needs a browser of 2023 or later.`;
  trouble.hidden = false;
}

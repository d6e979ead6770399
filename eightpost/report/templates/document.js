// Figures in panels, converted to the chosen units.

const TICKS = [-4, -3, -2, -1, 0, 1, 2, 3].flatMap((k) => [1, 2, 5].map((n) => Number(`${n}e${k}`)));
const places = [...document.querySelectorAll(".plot")];
let content;
const shownIn = (unit) => (unit in content.units && !metric ? content.units[unit] : [1, unit]);
const scaled = (values, by) => (by === 1 ? values : values.map((value) => value * by));

/** Return a trace in the chosen units; a bubble's text is its value to three digits. */
function trace(units, given) {
  const drawn = { ...given, name: plain(given.name), legendgroup: plain(given.legendgroup),
    x: scaled(given.x, shownIn(units[given.xaxis])[0]), y: scaled(given.y, shownIn(units[given.yaxis])[0]) };
  if (given.meta) drawn.text = given.meta.values.map((v) => (v * shownIn(given.meta.unit)[0]).toPrecision(3));
  return drawn;
}

function layout(units, given) {
  const whole = { ...PAPER, hovermode: "closest", ...given,
    annotations: given.annotations.map((note) => ({ ...note, text: plain(note.text) })) };
  for (const [axis, unit] of Object.entries(units)) {
    const key = axis[0] + "axis" + axis.slice(1), title = given[key].title;
    const text = unit && title.text ? `${title.text} [${shownIn(unit)[1]}]` : title.text;
    const ticks = given[key].type !== "log" ? {} : unit.endsWith("2/Hz") ? { dtick: 2, exponentformat: "power" }
      : { tickvals: TICKS, ticktext: TICKS.map(String) };
    whole[key] = { ...given[key], ...ticks, title: { ...title, text } };
  }
  return whole;
}

const NARROW = 760, PANEL = 250, GAP = 62; // width of a small screen, height of a panel and of its axis there [px]
let stacked = document.body.clientWidth < NARROW; // on paper never

/** Return a layout with its panels one below the other in the width of a small screen. */
function inOneColumn(whole, figure, width) {
  const xs = Object.keys(figure.units).filter((axis) => axis.startsWith("x")), { t, b } = whole.margin;
  const names = new Set(figure.data.filter((one) => one.showlegend).map((one) => one.name));
  const top = Math.max(t, 19 * names.size + 48), inner = xs.length * (PANEL + GAP) - GAP;
  const old = xs.map((axis) => [whole["xaxis" + axis.slice(1)].domain, whole["yaxis" + axis.slice(1)].domain]);
  const one = { ...whole, width, height: top + inner + b, margin: { ...whole.margin, l: 54, r: 6, t: top } };
  one.legend = { ...whole.legend, orientation: "v", tracegroupgap: 0 };
  xs.forEach((axis, k) => {
    const high = 1 - (k * (PANEL + GAP)) / inner, n = axis.slice(1);
    one["xaxis" + n] = { ...whole["xaxis" + n], domain: [0, 1] };
    one["yaxis" + n] = { ...whole["yaxis" + n], domain: [Math.max(0, high - PANEL / inner), high] };
  });
  one.annotations = whole.annotations.map((note) => {
    const k = old.findIndex(([x, y]) => Math.abs((x[0] + x[1]) / 2 - note.x) < 1e-6 && Math.abs(y[1] - note.y) < 1e-6);
    return k < 0 ? note : { ...note, x: 0.5, y: one["yaxis" + xs[k].slice(1)].domain[1] };
  });
  return one;
}

function draw(place) {
  place.drawn = true;
  const figure = content.figures[Number(place.dataset.figure)];
  const whole = layout(figure.units, figure.layout);
  const shown = stacked ? inOneColumn(whole, figure, document.body.clientWidth - 32) : whole;
  place.style.width = `${shown.width}px`;
  place.style.height = `${shown.height}px`;
  Plotly.react(place, figure.data.map((one) => trace(figure.units, one)), shown, SETTINGS);
}

/** Draw all figures with their panels stacked or not. */
function drawAll(narrow) {
  if (narrow === stacked || !content || !window.Plotly) return;
  stacked = narrow;
  places.filter((place) => place.drawn).forEach(draw);
}

/** Copy the cells of a table that are shown, separated by tabs. */
async function copied(table) {
  const lines = [...table.rows].map((row) => [...row.cells].map((cell) => cell.innerText.trim()).join("\t"));
  const text = lines.join("\n").replace(/\u2212/g, "-") + "\n";
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const box = document.body.appendChild(document.createElement("textarea"));
    box.value = text;
    box.select();
    document.execCommand("copy");
    box.remove();
  }
}

for (const table of document.querySelectorAll("section .scroll > table")) {
  const button = document.createElement("button");
  button.className = "copy";
  button.textContent = "Copy table";
  button.addEventListener("click", async () => {
    await copied(table);
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = "Copy table"), 1500);
  });
  table.parentElement.before(button);
}

/** Draw the remaining plots one after the other, so that all of them can be printed. */
function drawRest() {
  const left = places.find((place) => !place.drawn);
  if (!left) {
    document.body.dataset.drawn = "all";
    return;
  }
  draw(left);
  setTimeout(drawRest, 0);
}

onUnits(() => places.filter((place) => place.drawn).forEach(draw));
try {
  content = JSON.parse(await textOf("figures"));
  await loadPlotly();
  window.addEventListener("beforeprint", () => {
    drawAll(false);
    places.filter((place) => !place.drawn).forEach(draw);
  });
  window.addEventListener("afterprint", () => drawAll(document.body.clientWidth < NARROW));
  window.addEventListener("resize", () => drawAll(document.body.clientWidth < NARROW));
  drawRest();
} catch (error) {
  fail("The plots", error);
}

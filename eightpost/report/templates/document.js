// Figures in panels, converted to the chosen units.

const TICKS = [-4, -3, -2, -1, 0, 1, 2, 3].flatMap((k) => [1, 2, 5].map((n) => Number(`${n}e${k}`)));
const places = [...document.querySelectorAll(".plot")];
// Colours of a dark screen for those of eightpost/report/charts.py, which are made for white paper.
const DARK = { "#0072b2": "#4aa3dc", "#d55e00": "#f08a4b", "#009e73": "#3fc79f", "#8e5a9b": "#c592d2", "#4d4d4d": "#c3cad3",
  "#a6374f": "#ea8098", "#e6e9ee": "#2b323c", "#c3cad3": "#566271", "#b9c1cb": "#566271", "#eceff3": "#262d36",
  "#5b6675": "#a3aebc", "#9aa4b1": "#667283", "#1c2430": "#e4e9f0" };
const darkness = matchMedia("(prefers-color-scheme: dark)");
let printing = false, dark = false; // print is always in light colours
let source, content; // the figures as text, and in the colours of the screen or of paper
const shownIn = (unit) => (unit in content.units && !metric ? content.units[unit] : [1, unit]);
const scaled = (values, by) => (by === 1 ? values : values.map((value) => value * by));

/** Return a trace in the chosen units. */
function trace(units, given) {
  return { ...given, name: plain(given.name), legendgroup: plain(given.legendgroup),
    x: scaled(given.x, shownIn(units[given.xaxis])[0]), y: scaled(given.y, shownIn(units[given.yaxis])[0]) };
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
let wide = document.body.clientWidth; // width for which the figures are drawn; only stacked ones depend on it

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
  const shown = stacked ? inOneColumn(whole, figure, wide - 32) : whole;
  place.style.width = `${shown.width}px`;
  place.style.height = `${shown.height}px`;
  Plotly.react(place, figure.data.map((one) => trace(figure.units, one)), shown, SETTINGS);
}

/** Choose light or dark colours, for the page and for the figures drawn from now on. */
function color() {
  document.documentElement.classList.toggle("light", printing);
  dark = darkness.matches && !printing;
  content = JSON.parse(source, dark ? (_key, value) => (typeof value === "string" && DARK[value]) || value : undefined);
}

/** Draw all figures again if they are to be stacked or not, in another width, or in other colours. */
function drawAll(narrow) {
  const same = narrow === stacked && (!narrow || wide === document.body.clientWidth);
  const unchanged = same && dark === (darkness.matches && !printing);
  if (!content || !window.Plotly || unchanged) return;
  [stacked, wide] = [narrow, document.body.clientWidth];
  color();
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

/** Let the keyboard reach what is wider than the screen, so that it can scroll there. */
function reachWide() {
  for (const box of document.querySelectorAll(".scroll, .frame")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}

/** Whether a plot is not in a folded section. */
const isShown = (place) => !place.closest("details:not([open])");

/** Draw the remaining plots one after the other, so that all of them can be printed. */
function drawRest() {
  const left = places.find((place) => !place.drawn && isShown(place));
  if (!left) {
    reachWide();
    document.body.dataset.drawn = "all";
    return;
  }
  draw(left);
  setTimeout(drawRest, 0);
}

onUnits(() => places.filter((place) => place.drawn).forEach(draw));
try {
  source = await textOf("figures");
  color();
  await loadPlotly();
  window.addEventListener("beforeprint", () => {
    printing = true;
    drawAll(false);
    places.filter((place) => !place.drawn && isShown(place)).forEach(draw);
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    drawAll(document.body.clientWidth < NARROW);
  });
  for (const folded of document.querySelectorAll("section > details")) folded.addEventListener("toggle", drawRest);
  darkness.addEventListener("change", () => drawAll(stacked));
  window.addEventListener("resize", () => {
    drawAll(document.body.clientWidth < NARROW);
    reachWide();
  });
  drawRest();
} catch (error) {
  fail("The plots", error);
}

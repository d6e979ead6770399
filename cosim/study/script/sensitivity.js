// Main effects of the builds at each corner on the chosen measure, and interactions of two corners.

const sensitivityPlace = document.getElementById("effects");
let sensitivityIsNear = false;

if (sensitivityPlace) new IntersectionObserver(([{ isIntersecting }]) => {
  sensitivityIsNear = isIntersecting;
  drawSensitivity();
}, { rootMargin: "300px" }).observe(sensitivityPlace);

const effectLayout = (more) => ({ ...PAPER, margin: { l: 70, r: 10, t: 30, b: 46 }, height: 330, ...more });

async function drawSensitivity() {
  if (!sensitivityPlace) return;
  const terms = manifest.sensitivities.find(({ column }) => column === state.focus);
  const missing = document.getElementById("no-effects");
  missing.hidden = Boolean(terms);
  sensitivityPlace.hidden = !terms;
  document.getElementById("pair-place").hidden = !terms?.pairs.length;
  for (const line of document.querySelectorAll("#shares tr[data-column]")) {
    line.classList.toggle("current", Number(line.dataset.column) === state.focus);
  }
  if (!terms || !(sensitivityIsNear || sensitivityPlace.data)) return;
  await loadPlotly();
  drawMain(terms);
  drawPair(terms);
}

const upper = (name) => name.split("+").map((part) => part.toUpperCase()).join("+");

function drawMain(terms) {
  const column = focus();
  const lines = terms.factors.map(({ name, builds, effect }, k) => ({ type: "scatter", mode: "lines+markers", name: plain(upper(name)),
    x: builds.map(plain), y: effect.map((value) => width(column, value)), line: { color: LINES[k % LINES.length], width: 1.6 },
    marker: { size: 8, symbol: k }, hovertemplate: `%{x}: %{y:+.3~g} ${unit(column)}` }));
  const title = `effect on ${plain(column.name)}${inUnit(column)}`;
  Plotly.react(sensitivityPlace, lines, effectLayout({
    title: { text: "Main effects: mean of all setups with that build at that corner, minus the mean of all setups", font: { size: 12 }, x: 0.01, xanchor: "left" },
    xaxis: { ...AXIS, type: "category", categoryorder: "array", categoryarray: manifest.builds.map(plain) },
    yaxis: { ...AXIS, zeroline: true, zerolinecolor: tint("soft"), title: { text: title, font: { size: 12 } } } }), PLOT);
}

function drawPair(terms) {
  const choice = document.getElementById("pair"), place = document.getElementById("interaction");
  if (!terms.pairs.length) return;
  if (choice.options.length !== terms.pairs.length) {
    choice.replaceChildren(...terms.pairs.map(({ names }, k) => new Option(names.map(upper).join(" × "), k)));
    const shares = terms.pairs.map(({ share }) => share);
    choice.value = shares.indexOf(Math.max(...shares));
  }
  const { names, effect } = terms.pairs[Number(choice.value)], column = focus();
  const buildsOf = (name) => terms.factors.find((factor) => factor.name === name).builds.map(plain);
  const values = effect.map((line) => line.map((value) => width(column, value)));
  const most = Math.max(...values.flat().map(Math.abs), 1e-300);
  Plotly.react(place, [{ type: "heatmap", x: buildsOf(names[1]), y: buildsOf(names[0]), z: values, zmin: -most, zmax: most,
    colorscale: [[0, "#2166ac"], [0.5, "#f7f7f7"], [1, "#b2182b"]], hovertemplate: `%{y}, %{x}: %{z:+.3~g} ${unit(column)}<extra></extra>`,
    colorbar: { thickness: 12, title: { text: unit(column), font: { size: 11 } } } }], effectLayout({
    title: { text: "Interaction: effect of both builds together in addition to their main effects", font: { size: 12 }, x: 0.01, xanchor: "left" },
    xaxis: { ...AXIS, type: "category", title: { text: upper(names[1]) } },
    yaxis: { ...AXIS, type: "category", autorange: "reversed", title: { text: upper(names[0]) } } }), PLOT);
}

// Event handlers, and the start of the page.

function redraw() {
  if (!data) return;
  fillWeights();
  drawSetup();
  redrawTraces();
  drawSensitivity();
  update();
}

function switchBuild(event) {
  const { corner, build } = event.target.dataset, off = state.off[Number(corner)];
  if (event.target.checked) off.delete(Number(build)); else off.add(Number(build));
  update();
}

/** Switch all builds of a corner on; if all are on, switch them off. */
function switchCorner(event) {
  const corner = Number(event.target.dataset.all), boxes = document.querySelectorAll(`#builds input[data-corner="${corner}"]`);
  const checked = state.off[corner].size > 0;
  for (const box of boxes) {
    box.checked = checked;
    if (checked) state.off[corner].delete(Number(box.dataset.build)); else state.off[corner].add(Number(box.dataset.build));
  }
  update();
}

function clearAll() {
  for (const set of state.off) set.clear();
  for (const box of document.querySelectorAll("#builds input")) box.checked = true;
  for (const box of document.querySelectorAll("#kept input")) { box.checked = false; state.kept[box.value] = false; }
  state.words = document.getElementById("find").value = "";
  unbrush();
}

/** Put an apostrophe before a text that a spreadsheet would interpret as a formula; leave numbers unchanged. */
const formula = /^'*[=+\-@\t\r\n＝＋－＠]/, number = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
const safe = (text) => (formula.test(text) && !number.test(text) ? `'${text}` : text);
const quoted = (text) => `"${safe(String(text)).replace(/"/g, '""')}"`;

/** Save the rows of the table as CSV, in the units shown. */
function download() {
  const names = ["rank", "setup", ...manifest.corners, ...data.columns.map((column) => column.name)];
  const units = ["", "", ...manifest.corners.map(() => ""), ...data.columns.map(unit)];
  const lines = listed.map((row) => [data.rank[row], data.numbers[row], ...label(row),
    ...data.columns.map((column) => convert(column, column.values[row]))]);
  const text = [names, units, ...lines].map((line) => line.map(quoted).join(",")).join("\r\n");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text + "\r\n"], { type: "text/csv" }));
  link.download = "setups.csv";
  link.click();
  URL.revokeObjectURL(link.href);
}

function on(id, event, action) {
  document.getElementById(id).addEventListener(event, action);
}

function listenFilters() {
  on("builds", "change", switchBuild);
  for (const button of document.querySelectorAll("[data-all]")) button.addEventListener("click", switchCorner);
  on("find", "input", (event) => { state.words = event.target.value; update(); });
  on("kept", "change", (event) => { state.kept[event.target.value] = event.target.checked; update(); });
  on("clear", "click", clearAll);
  on("unbrush", "click", unbrush);
  on("download", "click", download);
  on("unpick", "click", () => { state.picked.clear(); update(); });
  document.getElementById("compare-ties")?.addEventListener("click", compareTies);
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") unbrush(); });
}

/** Pick the tied setups that the answer lists, and show them side by side. */
function compareTies() {
  for (const line of document.querySelectorAll("#tied [data-setup]")) state.picked.add(Number(line.dataset.setup));
  update();
  document.getElementById("comparison").scrollIntoView();
}

function showColumn(column, visible) {
  if (visible) state.tabled.add(column); else state.tabled.delete(column);
  document.querySelector(`#tabled input[value="${column}"]`).checked = visible;
}

function listenViews() {
  on("focus", "change", (event) => focusOn(Number(event.target.value)));
  on("colored", "change", (event) => { state.colored = Number(event.target.value); update(); });
  on("tabled", "change", ({ target }) => { showColumn(Number(target.value), target.checked); update(); });
  on("against", "change", () => { makeTrades(); update(); });
  on("pick-current", "change", (event) => pick(state.current, event.target.checked));
  on("spectrum", "change", () => drawChannel(comparedRows()));
  on("with-baseline", "change", redrawTraces);
  on("whole", "click", () => zoomTraces(wholeOf(traceOf(state.current))));
  document.getElementById("pair")?.addEventListener("change", drawSensitivity);
  for (const line of document.querySelectorAll("[data-setup]")) {
    line.addEventListener("click", () => { choose(Number(line.dataset.setup)); });
  }
  for (const line of document.querySelectorAll("#shares tr[data-column]")) {
    line.addEventListener("click", () => focusOn(Number(line.dataset.column)));
  }
  window.addEventListener("resize", () => update());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColors(); redraw(); });
}

const PRINTED = 12; // rows of the ranking

function listenPrint() {
  window.addEventListener("beforeprint", () => {
    printing = true;
    lighten(true);
    drawPanels(true);
    fillWindow(Math.min(listed.length, PRINTED));
  });
  window.addEventListener("afterprint", () => { printing = false; lighten(false); redraw(); });
}

/** Use the light colours also on a dark screen, for a print. */
function lighten(on) {
  document.documentElement.classList.toggle("light", on);
  document.documentElement.classList.toggle("printing", on); // as wide as the paper
  readColors();
}

/** Reset all inputs: a browser that reloads a page would keep their old state. */
function resetInputs() {
  for (const box of document.querySelectorAll("input[type=checkbox], input[type=radio]")) box.checked = box.defaultChecked;
  for (const box of document.querySelectorAll("input[type=search]")) box.value = "";
}

resetInputs();
onUnits(redraw);
readColors();
try {
  data = decode(await unpacked("numbers"));
  for (const row of manifest.picked) state.picked.add(row);
  state.focus = Number(document.getElementById("focus").value);
  state.current = manifest.best;
  for (const box of document.querySelectorAll("#tabled input:checked")) state.tabled.add(Number(box.value));
  listenTable();
  listenFilters();
  listenViews();
  listenPrint();
  listenWeights();
  applyFilters();
  makeTrends();
  makeParallel();
  focusOn(state.focus);
  drawSetup();
  refresh();
  fitTable();
  document.body.dataset.ready = "yes";
} catch (error) {
  fail("The plots and tables of this page", error);
}

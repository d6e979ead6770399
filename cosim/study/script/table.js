// The ranking. The document contains only the rows that are visible.

const ROW = 26; // height of a row [px]; page.css has the same value
const MORE = 8; // rows kept above and below the visible ones
const table = document.getElementById("ranking");
const pane = document.getElementById("ranking-pane");
let listed = []; // rows in the order of the table

const FEWEST = 3; // measures that stay in the table of a narrow window

const tabled = () => data.columns.map((column, k) => [column, k]).filter(([, k]) => state.tabled.has(k));

/** Whether a column has intervals, and is what setups are ranked by: its cells show them as numbers. */
const isBounded = (column) => column === data.columns[0] && Boolean(column.uncertainty);

const heads = () => [
  { key: "pick", text: "picked", sortable: false, kind: "pick" },
  { key: "rank", text: "rank", kind: "number rank" },
  { key: "number", text: "setup", kind: "number" },
  ...manifest.corners.map((corner, k) => ({ key: `corner${k}`, text: corner.toUpperCase(), kind: "build" })),
  ...(data.chance ? [{ key: "chance", text: manifest.chance.name, kind: "number chance" }] : []),
  ...tabled().map(([column, k]) => ({ key: `column${k}`, text: `${column.name}${inUnit(column)}${isBounded(column) ? " (95 % interval)" : ""}`, kind: "number level" })),
  { key: "error", text: "coupling error [%]", kind: "number" },
  { key: "marks", text: "marks", kind: "marks" },
];

function keyOf(key) {
  if (key === "rank") return data.rank;
  if (key === "number") return data.numbers;
  if (key === "error") return data.error;
  if (key === "chance") return data.chance;
  if (key === "marks") return Float64Array.from({ length: data.count }, (_, row) => (remark(row) ? 0 : 1));
  const place = Number(key.match(/\d+/)[0]);
  return key.startsWith("corner") ? data.placed[place] : data.columns[place].values;
}

let order = null; // all setups in the order of the table; null if it must be sorted again

/** Sort all setups. Equal values are ordered by rank; setups without a value are always last. */
function sorted() {
  const by = keyOf(state.sort.key), sign = state.sort.falling ? -1 : 1;
  if (by === data.rank) return state.sort.falling ? byRank().reverse() : byRank();
  return Uint32Array.from({ length: data.count }, (_, row) => row).sort((a, b) => Number(isNaN(by[a])) - Number(isNaN(by[b]))
    || sign * (by[a] - by[b]) || data.rank[a] - data.rank[b]);
}

let headOf = ""; // what the header row shows

/** Write the header row, unless it is the same: a button that has the focus would lose it. */
function fillHead() {
  const wanted = JSON.stringify([state.sort, heads()]);
  if (wanted === headOf) return;
  headOf = wanted;
  const focused = document.activeElement.closest?.("#ranking th")?.dataset.key;
  table.tHead.innerHTML = "";
  const line = table.tHead.insertRow();
  for (const { key, text, kind, sortable = true } of heads()) {
    const cell = document.createElement("th");
    cell.className = kind;
    cell.dataset.key = key;
    if (sortable) {
      const sort = key === state.sort.key ? (state.sort.falling ? "descending" : "ascending") : "none";
      cell.setAttribute("aria-sort", sort);
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      cell.append(button);
    } else cell.innerHTML = `<span class="unseen">${text}</span>`;
    line.append(cell);
  }
  if (focused) line.querySelector(`th[data-key="${focused}"] button`)?.focus();
}

const remark = (row) => manifest.failures[row]
  || [manifest.marks[row], data.allowed[row] ? "" : "breaks a constraint"].filter(Boolean).join(", ");

function cell(line, text, kind) {
  const added = line.insertCell();
  added.className = kind;
  added.textContent = text;
  return added;
}

const chanceOf = (row) => (data.chance[row] < 0.001 ? "< 0.1 %" : percent(data.chance[row]));

/** Write the value of a measure: shaded by its level, with a line for its 95 % interval. */
function fillLevel(line, column, row) {
  const spread = spreadOf(column, row), text = figure(convert(column, column.values[row]));
  const here = cell(line, isBounded(column) ? text + spread : text, "number level");
  here.style.setProperty("--level", `${100 * (column.levels[row] || 0)}%`);
  if (!spread) return;
  here.classList.add("spread");
  here.title = text + spread;
  const [low, high] = endsOf(column, row).map((end) => 100 * (end - column.low) / (column.high - column.low || 1));
  here.style.setProperty("--from", `${low}%`);
  here.style.setProperty("--to", `${Math.max(high, low + 2)}%`);
}

function fillRow(row) {
  const line = document.createElement("tr");
  line.dataset.row = row;
  line.className = [row === state.current && "current", row === manifest.baseline && "baseline",
    manifest.failures[row] ? "failed" : manifest.marks[row] && "marked"].filter(Boolean).join(" ");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = state.picked.has(row);
  box.setAttribute("aria-label", `pick setup ${data.numbers[row]}`);
  cell(line, "", "pick").append(box);
  cell(line, manifest.failures[row] ? "–" : data.rank[row], "number rank");
  cell(line, data.numbers[row], "number");
  for (const corner of manifest.corners.keys()) {
    const build = data.placed[corner][row];
    cell(line, manifest.builds[build], "build").style.setProperty("--build", manifest.colors[build]);
  }
  if (data.chance) cell(line, chanceOf(row), "number");
  for (const [column] of tabled()) fillLevel(line, column, row);
  cell(line, figure(data.error[row], 2), "number");
  const last = cell(line, remark(row), "marks");
  last.title = remark(row);
  return line;
}

function fillTable() {
  fillHead();
  order ??= sorted();
  listed = Array.from(order.filter((row) => shown[row]));
  fillWindow();
}

/** Leave measures out of the table until it fits the window. */
function fitTable() {
  for (const [, k] of tabled().slice(FEWEST).reverse()) {
    if (pane.scrollWidth <= pane.clientWidth) return;
    showColumn(k, false);
    fillTable();
  }
}

function spacer(height) {
  const line = document.createElement("tr");
  line.className = "spacer";
  line.style.height = `${height}px`;
  return line;
}

/** Write the visible rows between two empty rows that are as high as the rows left out. */
function fillWindow(all = 0) {
  const first = Math.max(0, Math.floor(pane.scrollTop / ROW) - MORE);
  const last = all || Math.min(listed.length, first + Math.ceil(pane.clientHeight / ROW) + 2 * MORE);
  const body = document.createElement("tbody");
  const focused = document.activeElement.closest?.("#ranking tr[data-row]")?.dataset.row;
  body.append(spacer(ROW * first), ...listed.slice(first, last).map(fillRow), spacer(ROW * Math.max(0, listed.length - last)));
  table.tBodies[0].replaceWith(body);
  if (focused) body.querySelector(`tr[data-row="${focused}"] input`)?.focus({ preventScroll: true });
  document.getElementById("nothing").hidden = listed.length > 0;
}

function sortBy(key) {
  state.sort = { key, falling: state.sort.key === key && !state.sort.falling };
  order = null;
  pane.scrollTop = 0;
  fillTable();
}

function onTableClick(event) {
  const head = event.target.closest("th[aria-sort]"), line = event.target.closest("tbody tr[data-row]");
  if (head) sortBy(head.dataset.key);
  else if (event.target.matches("input")) pick(Number(line.dataset.row), event.target.checked);
  else if (line) choose(Number(line.dataset.row));
}

/** Show the setup in the next or the previous row of the table. */
function onTableKey(event) {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || !listed.length) return;
  event.preventDefault();
  const place = Math.min(Math.max(listed.indexOf(state.current) + step, 0), listed.length - 1);
  const top = ROW * place, room = pane.clientHeight - table.tHead.offsetHeight - ROW;
  if (top < pane.scrollTop) pane.scrollTop = top; else if (top > pane.scrollTop + room) pane.scrollTop = top - room;
  choose(listed[place]);
  document.getElementById("spoken").textContent = describeSetup(listed[place], [focus()]);
}

function listenTable() {
  table.addEventListener("click", onTableClick);
  pane.addEventListener("keydown", onTableKey);
  let pending = false;
  pane.addEventListener("scroll", () => {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => { pending = false; fillWindow(); });
  });
}

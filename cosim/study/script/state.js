// The data of the page, the reader's choices, and the setups that pass them.

const manifest = JSON.parse(document.getElementById("manifest").textContent);

/** Return the columns, setups and builds as typed arrays; `numbers` is the block of bytes. */
function decode(numbers) {
  const count = manifest.setups;
  const doubles = (at, length = count) => new Float64Array(numbers, at, length);
  const columns = manifest.columns.map((column) => {
    const values = doubles(column.at), span = column.high - column.low || 1;
    const { uncertainty } = column;
    const known = uncertainty && Object.fromEntries(["low", "high", "best", "tied"].map((key) => [key, doubles(uncertainty[key])]));
    return { ...column, values, uncertainty: known, ties: uncertainty?.ties, levels: Float64Array.from(values, (value) => (value - column.low) / span) };
  });
  const placed = manifest.corners.map((_, corner) => Uint16Array.from(doubles(manifest.placed[corner])));
  return { count, columns, placed, numbers: doubles(manifest.numbers), rank: doubles(manifest.rank),
    allowed: doubles(manifest.allowed), error: doubles(manifest.error), bytes: numbers,
    chance: manifest.chance && doubles(manifest.chance.at), tied: new Set(manifest.ties) };
}

let data; // see decode
let shown; // one byte per setup: whether it passes the filters and is inside the brush
let waiting = false;

const state = {
  focus: 0, // the column whose levels and trade-offs are drawn
  colored: 0, // the corner whose build gives a setup its colour
  sort: { key: "rank", falling: false },
  off: manifest.corners.map(() => new Set()), // builds filtered out, by corner
  words: "",
  kept: { allowed: false, unmarked: false, tied: false, picked: false },
  wishes: new Map(), // weight and limits of each column, see weights.js
  spans: new Map(), // ranges of levels dragged in the parallel coordinates, by column
  brush: null, // { arrays: [xs, ys], from: [x, y], to: [x, y] }
  tabled: new Set(), // the columns of the ranking
  picked: new Set(),
  current: null,
};

const label = (row) => manifest.corners.map((_, corner) => manifest.builds[data.placed[corner][row]]);
const unit = (column) => {
  const { unit: name } = metric ? column.metric : column.us;
  return name === "1" ? "" : name;
};
const inUnit = (column) => (unit(column) ? ` [${unit(column)}]` : "");
const convert = (scale, value) => {
  const shownAs = metric ? scale.metric : scale.us;
  return shownAs.factor * value + shownAs.offset;
};
const width = (scale, value) => (metric ? scale.metric : scale.us).factor * value;

/** Format a number with four significant digits and a true minus sign. */
function figure(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-4)) return powered(value.toExponential(digits - 1));
  return minus(value.toFixed(size === 0 ? 0 : Math.max(0, digits - 1 - Math.floor(Math.log10(size) + 1e-9))));
}

const minus = (text) => text.replace("-", "−");
const raised = (digits) => [...digits].map((digit) => (digit === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit])).join("");

function powered(text) { // 1.2e-5 as 1.2·10⁻⁵
  const [mantissa, exponent] = text.split("e");
  return `${minus(mantissa)}·10${raised(exponent.replace("+", ""))}`;
}

/** Format a share [1] in percent. */
const percent = (share, digits = 1) => (Number.isFinite(share) ? `${minus((100 * share).toFixed(digits))} %` : "–");

/** Return the ends of the 95 % interval of a value in SI; NaN if it is not known. */
const endsOf = ({ uncertainty }, row) => (uncertainty ? [uncertainty.low[row], uncertainty.high[row]] : [NaN, NaN]);

/** Return the 95 % interval of a value as text; empty if it is not known. */
function spreadOf(column, row) {
  const ends = endsOf(column, row);
  return ends.every(Number.isFinite) ? ` (${ends.map((end) => figure(convert(column, end))).join(" to ")})` : "";
}

/** Return all rows by their rank. */
function byRank() {
  const rows = new Uint32Array(data.count);
  for (let row = 0; row < data.count; row++) rows[data.rank[row] - 1] = row;
  return rows;
}

function brushed(row) {
  if (!state.brush) return true;
  const { arrays: [xs, ys], from, to } = state.brush, x = xs[row], y = ys[row];
  return x >= from[0] && x <= to[0] && y >= from[1] && y <= to[1];
}

function matches(row, words) {
  if (!words.length) return true;
  const text = `${data.numbers[row]} ${label(row).join(" ")} ${manifest.marks[row] || ""}`.toLowerCase();
  return words.every((word) => text.includes(word));
}

function filtered(row, words) {
  if (state.off.some((builds, corner) => builds.has(data.placed[corner][row]))) return false;
  if (state.kept.allowed && !data.allowed[row]) return false;
  if (state.kept.unmarked && (manifest.marks[row] || manifest.failures[row])) return false;
  if (state.kept.tied && !data.tied.has(row)) return false;
  if (state.kept.picked && !state.picked.has(row)) return false;
  for (const [k, [low, high]] of state.spans) {
    const level = data.columns[k].levels[row];
    if (!(level >= low && level <= high)) return false;
  }
  return matches(row, words);
}

function applyFilters() {
  const words = state.words.toLowerCase().split(/\s+/).filter(Boolean);
  shown = new Uint8Array(data.count);
  for (let row = 0; row < data.count; row++) shown[row] = filtered(row, words) && brushed(row) ? 1 : 0;
}

/** Redraw everything that depends on the choices, at most once per frame. */
function update() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(refresh);
}

function refresh() {
  waiting = false;
  applyFilters();
  showCounts();
  fillTable();
  drawPanels();
  drawParallel();
  drawComparison();
}

function showCounts() {
  let count = 0;
  for (const one of shown) count += one;
  document.getElementById("shown").textContent = `${count} of ${data.count} setups`;
  document.getElementById("unbrush").hidden = !state.brush && !state.spans.size;
  document.getElementById("pickings").textContent = state.picked.size;
  document.getElementById("chosen").textContent = state.current === null ? "none"
    : `${data.numbers[state.current]}: ${label(state.current).join(" · ")}`;
}

function choose(row) {
  state.current = row;
  drawSetup();
  update();
}

function pick(row, picked) {
  if (picked) state.picked.add(row); else state.picked.delete(row);
  update();
}

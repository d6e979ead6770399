// What if: other weights of the objective and other limits of the measures. Setups are ranked again in the page.

const terms = new Map(manifest.terms.map((term) => [term.column, term])); // of the study's objective, by column
const bounds = manifest.bounds; // of the study's constraints: { column, low, high } in SI
let own = null; // ranks and objective of the study itself

const limitOf = (column) => bounds.find((bound) => bound.column === column) || { low: null, high: null };
const ownWishes = () => new Map(data.columns.map((_, k) => [k, { weight: terms.get(k)?.weight || 0, ...limitOf(k) }]));

/** Return the unit in which a measure counts in the objective: that of its term, else its display unit. */
const counted = (column) => terms.get(column) || { ...data.columns[column].us };

function inputOf(column, field, value, name) {
  const box = document.createElement("input");
  box.type = "number";
  box.step = "any";
  box.value = value === null || value === undefined ? "" : Number(value.toPrecision(6));
  box.dataset.column = column;
  box.dataset.field = field;
  box.setAttribute("aria-label", `${name} ${data.columns[column].name}`);
  return box;
}

/** Write the table of weights and limits. */
function fillWeights() {
  const body = document.getElementById("weights").tBodies[0];
  body.replaceChildren();
  for (const [k, column] of data.columns.entries()) {
    if (k === 0 && manifest.objective) continue;
    const line = body.insertRow(), wish = state.wishes.get(k);
    cell(line, column.name, "name");
    cell(line, "", "number").append(inputOf(k, "weight", wish.weight, "weight of"));
    cell(line, `per ${counted(k).unit === "1" ? "unit" : counted(k).unit}`, "soft");
    const shownLimit = (value) => (value === null ? null : convert(column, value));
    cell(line, "", "number").append(inputOf(k, "low", shownLimit(wish.low), "at least"));
    cell(line, "", "number").append(inputOf(k, "high", shownLimit(wish.high), "at most"));
    cell(line, unit(column), "soft");
  }
}

function onWish({ target }) {
  const { column, field } = target.dataset, one = data.columns[Number(column)], typed = target.value.trim();
  const scale = metric ? one.metric : one.us, value = typed === "" ? null : Number(typed);
  if (value !== null && !Number.isFinite(value)) return;
  const wish = state.wishes.get(Number(column));
  wish[field] = field === "weight" ? value || 0 : value === null ? null : (value - scale.offset) / scale.factor;
  rankAgain();
}

const isOwn = () => {
  const mine = ownWishes();
  return [...state.wishes].every(([k, wish]) => ["weight", "low", "high"].every((field) => wish[field] === mine.get(k)[field]));
};

/** Rank the setups by the chosen weights, among those that are within the chosen limits. */
function rankAgain() {
  own ??= { rank: data.rank, allowed: data.allowed, chance: data.chance, objective: { ...data.columns[0] } };
  const weighed = [...state.wishes].filter(([, { weight }]) => weight !== 0);
  const unchanged = isOwn(), note = document.getElementById("reweighed");
  note.hidden = unchanged;
  Object.assign(data.columns[0], own.objective);
  if (unchanged) Object.assign(data, { rank: own.rank, allowed: own.allowed, chance: own.chance });
  else {
    data.allowed = Float64Array.from({ length: data.count }, (_, row) => Number(withinLimits(row)));
    data.chance = null; // of the study's own weights and limits
    const cost = weighed.length ? costs(weighed) : own.objective.values;
    if (weighed.length && manifest.objective) showCost(cost);
    data.rank = ranksOf(cost);
    note.textContent = `${weighed.length ? "" : "No measure has a weight: ranked as in the study. "}`
      + "Ranked by these weights and limits. The answer at the top of the page and its probabilities are for those of the study.";
  }
  order = null;
  fronts.clear();
  drawSetup();
  update();
}

/** Show the chosen weights' sum in the column of the objective; its uncertainty is not known in the page. */
function showCost(cost) {
  let low = Infinity, high = -Infinity;
  for (const one of cost) if (Number.isFinite(one)) { low = Math.min(low, one); high = Math.max(high, one); }
  const levels = cost.map((one) => (one - low) / (high - low || 1));
  Object.assign(data.columns[0], { name: `${own.objective.name} (what if)`, values: cost, levels, low, high, uncertainty: null, ties: undefined });
}

function withinLimits(row) {
  for (const [k, { low, high }] of state.wishes) {
    const value = data.columns[k].values[row];
    if ((low !== null && !(value >= low)) || (high !== null && !(value <= high))) return false;
  }
  return true;
}

function costs(weighed) {
  const cost = new Float64Array(data.count);
  for (const [k, { weight }] of weighed) {
    const { factor, offset } = counted(k), { values } = data.columns[k];
    for (let row = 0; row < data.count; row++) cost[row] += weight * (factor * values[row] + offset);
  }
  return cost;
}

/** Return ranks as in the study: setups within the limits first, then the others, failed ones last. */
function ranksOf(cost) {
  const group = Uint8Array.from(cost, (one, row) => (manifest.failures[row] || !Number.isFinite(one) ? 2 : data.allowed[row] ? 0 : 1));
  const rows = Uint32Array.from(cost, (_, row) => row).sort((a, b) => group[a] - group[b]
    || (cost[a] - cost[b] || 0) || data.numbers[a] - data.numbers[b]);
  const ranks = new Float64Array(data.count);
  rows.forEach((row, place) => { ranks[row] = place + 1; });
  return ranks;
}

function listenWeights() {
  state.wishes = ownWishes();
  fillWeights();
  on("weights", "input", onWish);
  on("own-weights", "click", () => { state.wishes = ownWishes(); fillWeights(); rankAgain(); });
}

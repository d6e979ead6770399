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

function draw(place) {
  place.drawn = true;
  const figure = content.figures[Number(place.dataset.figure)];
  Plotly.react(place, figure.data.map((one) => trace(figure.units, one)), layout(figure.units, figure.layout), SETTINGS);
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
  window.addEventListener("beforeprint", () => places.filter((place) => !place.drawn).forEach(draw));
  drawRest();
} catch (error) {
  fail("The plots", error);
}

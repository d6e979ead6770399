// Plots, figures, and the drawing of the car.

const GREY = "#9aa5b1", BLUE = "#1f5f99", RED = "#c0182b";

/** Return samples in the unit of the reader. */
const shown = (unit, samples) => {
  const factor = unitOf(models.units[unit])[1];
  return Array.from(samples, (value) => value * factor);
};
const axisOf = (text, unit) => ({ ...AXIS, title: { text: `${text} [${unitOf(models.units[unit])[0]}]` } });
const line = (name, x, y, color, more = {}) => ({ name, x, y, mode: "lines", line: { color, width: 2, ...more } });

function draw(id, traces, x, y) {
  const layout = { ...PAPER, margin: { l: 60, r: 12, t: 8, b: 44 }, xaxis: x, yaxis: y, showlegend: true,
    legend: { orientation: "h", y: 1, yanchor: "bottom", x: 0 } };
  Plotly.react(id, traces, layout, { ...SETTINGS, responsive: true });
}

const BY_HAND = 3; // index of the trace by hand in both plots of the dynamometer

function drawDynamometer(now, before, trail) {
  const at = (of, name, unit) => shown(unit, of[name]);
  const hand = (k, unit) => shown(unit, trail.map((sample) => sample[k]));
  draw("velocity-plot", [
    line("as built", at(before, "velocity", "m/s"), at(before, "force", "N"), GREY),
    line("now", at(now, "velocity", "m/s"), at(now, "force", "N"), BLUE),
    line("static curve", at(now.curve, "velocity", "m/s"), at(now.curve, "force", "N"), BLUE, { width: 1, dash: "dot" }),
    line("by hand", hand(0, "m/s"), hand(1, "N"), RED, { width: 1 }),
  ], axisOf("velocity, positive in compression", "m/s"), axisOf("force", "N"));
  draw("travel-plot", [
    line("as built", at(before, "displacement", "m"), at(before, "force", "N"), GREY),
    line("now", at(now, "displacement", "m"), at(now, "force", "N"), BLUE),
  ], axisOf("displacement", "m"), axisOf("force", "N"));
}

/** Update the trace by hand alone, as often as the screen is drawn. */
function drawTrail(trail) {
  Plotly.restyle("velocity-plot", { x: [shown("m/s", trail.map((s) => s[0]))], y: [shown("N", trail.map((s) => s[1]))] }, [BY_HAND]);
}

function drawBump(now, before) {
  draw("tire-plot", [
    line("as built", Array.from(before.time), shown("N", before.tire), GREY),
    line("now", Array.from(now.time), shown("N", now.tire), BLUE),
    line("no contact", [0, now.time.at(-1)], [0, 0], RED, { width: 1, dash: "dot" }),
  ], axisOf("time", "s"), axisOf("tire force", "N"));
}

/** Write figures into a list of tiles: name, unit, value, value as built. */
function showFigures(id, figures) {
  const tile = ([name, unit, value, before]) => {
    const box = document.createElement("div");
    const cell = (tag, text, style = "") => {
      const element = document.createElement(tag);
      element.textContent = text;
      element.className = style;
      box.append(element);
    };
    cell("dt", name);
    cell("dd", amount(unit, value));
    cell("dd", `as built ${amount(unit, before)}`, "of");
    return box;
  };
  document.getElementById(id).replaceChildren(...figures.map(tile));
}

const DRAWN_HEIGHT = 0.3; // [m] of the real car on the canvas, where nothing moves
const MAGNIFIED = 4; // motion is drawn larger

/** Draw the car at sample k of a run; the road comes from the right. */
function drawCar(canvas, run, k) {
  const pen = canvas.getContext("2d"), { width, height } = canvas, middle = width / 2, ground = height - 45;
  const up = (metres) => (metres * MAGNIFIED * height) / (2 * DRAWN_HEIGHT), wheel = 38;
  pen.clearRect(0, 0, width, height);
  pen.lineWidth = 2;
  pen.strokeStyle = "#5b6675";
  pen.beginPath();
  for (let x = 0; x <= width; x += 4) {
    const sample = Math.round(k + ((x - middle) / width) * 400);
    pen.lineTo(x, ground - up(run.road[Math.max(0, Math.min(run.road.length - 1, sample))]));
  }
  pen.stroke();
  const hub = ground - wheel - up(run.wheel[k]), body = ground - 150 - up(run.chassis[k]);
  pen.strokeStyle = run.tire[k] > 0 ? BLUE : RED;
  pen.beginPath();
  pen.arc(middle, hub, wheel, 0, 2 * Math.PI);
  pen.stroke();
  pen.lineWidth = 5;
  pen.beginPath();
  pen.moveTo(middle, hub);
  pen.lineTo(middle, body);
  pen.stroke();
  pen.fillStyle = BLUE;
  pen.fillRect(middle - 95, body - 34, 190, 34);
}

"use strict";
(async () => {
  const SETTINGS = { displaylogo: false, responsive: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
  const TICKS = [-4, -3, -2, -1, 0, 1, 2, 3].flatMap((k) => [1, 2, 5].map((n) => Number(`${n}e${k}`)));
  const state = { metric: false };

  async function unpacked(id) {
    const letters = atob(document.getElementById(id).textContent.trim());
    const bytes = new Uint8Array(letters.length);
    for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new TextDecoder().decode(await new Response(stream).arrayBuffer());
  }

  async function loadPlotly() {
    const script = document.createElement("script");
    script.textContent = await unpacked("plotly");
    document.head.append(script);
  }

  let content;
  const factor = (unit) => (unit in content.units && !state.metric ? content.units[unit][0] : 1);
  const name = (unit) => (unit in content.units && !state.metric ? content.units[unit][1] : unit);
  const scaled = (values, by) => (by === 1 ? values : values.map((value) => value * by));
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  /** Return a trace in the chosen units; a bubble's text is its value to three digits. */
  function trace(units, given) {
    const drawn = { ...given, name: plain(given.name), legendgroup: plain(given.legendgroup),
      x: scaled(given.x, factor(units[given.xaxis])), y: scaled(given.y, factor(units[given.yaxis])) };
    if (given.meta) drawn.text = given.meta.values.map((v) => (v * factor(given.meta.unit)).toPrecision(3));
    return drawn;
  }

  function layout(units, given) {
    const whole = { font: { family: "system-ui, sans-serif", size: 12, color: "#1c2430" }, paper_bgcolor: "#fff",
      plot_bgcolor: "#fff", hovermode: "closest", modebar: { bgcolor: "rgba(0,0,0,0)" }, ...given,
      annotations: given.annotations.map((note) => ({ ...note, text: plain(note.text) })) };
    for (const [axis, unit] of Object.entries(units)) {
      const key = axis[0] + "axis" + axis.slice(1), title = given[key].title;
      const text = unit && title.text ? `${title.text} [${name(unit)}]` : title.text;
      const ticks = given[key].type === "log" ? (unit === "N2/Hz" ? { dtick: 2, exponentformat: "power" }
        : { tickvals: TICKS, ticktext: TICKS.map(String) }) : {};
      whole[key] = { ...given[key], ...ticks, title: { ...title, text } };
    }
    return whole;
  }

  function draw(place) {
    place.late = !place.near;
    if (place.late) return;
    const figure = content.figures[Number(place.dataset.figure)];
    Plotly.react(place, figure.data.map((one) => trace(figure.units, one)), layout(figure.units, figure.layout), SETTINGS);
  }

  const places = [...document.querySelectorAll(".plot")];

  function switchUnits(event) {
    state.metric = event.target.value === "si";
    document.body.classList.toggle("metric", state.metric);
    if (window.Plotly) places.forEach(draw);
  }

  /** Draw the remaining plots one after the other, so that all of them can be printed. */
  function drawRest() {
    const left = places.find((place) => place.late !== false);
    if (!left) {
      document.body.dataset.drawn = "all";
      return;
    }
    left.near = true;
    draw(left);
    setTimeout(drawRest, 0);
  }

  // The tables follow the units even if the plots cannot be drawn.
  for (const box of document.querySelectorAll("input[name=units]")) {
    box.checked = box.value === "us"; // a browser keeps the old choice when it reloads the page
    box.addEventListener("change", switchUnits);
  }
  try {
    content = JSON.parse(await unpacked("figures"));
    await loadPlotly();
    window.addEventListener("beforeprint", () => places.forEach((place) => {
      place.near = true;
      if (place.late !== false) draw(place);
    }));
    drawRest();
  } catch (error) {
    const trouble = document.getElementById("trouble");
    trouble.textContent = `The plots cannot be drawn (${error}); they need a browser of 2023 or later.`;
    trouble.hidden = false;
  }
})();

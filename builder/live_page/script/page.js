// The page: models, event handlers, start.

const page = { runs: {}, frame: null };
const questions = { dynamometer, bump };

/** Run a question for the shock as built and as it is now. */
function ask(name, model) {
  const question = values[name];
  page.runs[name] = { before: questions[name](model, built(), question), now: questions[name](model, values.shock, question) };
}

function show() {
  const { dynamometer: bench, bump: drive } = page.runs;
  drawDynamometer(bench.now, bench.before, page.hand.trail);
  showFigures("dynamometer-figures", dynamometerFigures(bench.now, bench.before));
  drawBump(drive.now, drive.before);
  showFigures("bump-figures", bumpFigures(drive.now, drive.before));
  if (page.frame === null) drawCar(page.canvas, drive.now, 0);
}

/** Compute what depends on a group of controls, and draw; a refusal of the FMU is shown, and the last result stays. */
function compute(group) {
  const refused = document.getElementById("refused");
  refused.hidden = true;
  try {
    if (group !== "bump") ask("dynamometer", page.shock);
    if (group !== "dynamometer") ask("bump", page.car);
    page.hand.restart({ ...values.shock });
  } catch (error) {
    refused.textContent = `The FMU refused these values: ${error.message}`;
    refused.hidden = false;
  }
  show();
}

const SLOWER = 10;

/** Drive over the bump once. */
function play() {
  cancelAnimationFrame(page.frame);
  const start = performance.now();
  const next = (time) => {
    const run = page.runs.bump.now, k = Math.floor((time - start) / 1e3 / SLOWER / BUMP_STEP);
    if (k >= run.time.length) {
      page.frame = null;
      return;
    }
    drawCar(page.canvas, run, Math.max(0, k));
    page.frame = requestAnimationFrame(next);
  };
  page.frame = requestAnimationFrame(next);
}

try {
  [page.shock, page.car] = await Promise.all([Fmu.load("shock"), Fmu.load("car")]);
  page.canvas = document.getElementById("car");
  page.hand = new Hand(await Fmu.load("shock"), document.getElementById("hand"), drawTrail);
  await loadPlotly();
  document.getElementById("magnified").textContent = MAGNIFIED;
  resetControls();
  compute();
  onControls(compute);
  onUnits(() => { everyControl(showControl); show(); });
  document.getElementById("reset").addEventListener("click", () => { resetControls(); compute(); });
  document.getElementById("play").addEventListener("click", play);
  globalThis.eightpost = page; // for scripts in the browser's console
  document.body.dataset.ready = "yes";
} catch (error) {
  fail("The page", error);
}

// The shock on the dynamometer: a sine of the velocity, and the loops of the last cycle.

const CYCLES = 3, SAMPLES = 400; // of which the last cycle is shown; per cycle
const HELD = 41, HOLD = 0.05, HOLD_STEPS = 5; // velocities of the static curve, time at each [s], in steps

/** Return the forces at held velocities in the middle of the stroke: with gas force and friction, without lag. */
function staticCurve(shock, parameters, peak, middle) {
  const count = HELD * HOLD_STEPS + 1;
  const heldAt = (k) => peak * ((2 * Math.floor(Math.max(k - 1, 0) / HOLD_STEPS)) / (HELD - 1) - 1);
  const velocity = Float64Array.from({ length: count }, (_, k) => heldAt(k)), displacement = new Float64Array(count).fill(middle);
  const { force } = shock.simulate(parameters, { velocity, displacement }, HOLD / HOLD_STEPS, ["force"]);
  const ends = Array.from({ length: HELD }, (_, n) => (n + 1) * HOLD_STEPS);
  return { velocity: ends.map((k) => velocity[k]), force: ends.map((k) => force[k]) };
}

/** Return the last cycle of a shock with the given parameters, and its figures. */
function dynamometer(shock, parameters, { "peak velocity": peak, frequency }) {
  const count = CYCLES * SAMPLES + 1, step = 1 / frequency / SAMPLES, rate = 2 * Math.PI * frequency;
  const velocity = new Float64Array(count), displacement = new Float64Array(count);
  for (let k = 0; k < count; k++) {
    velocity[k] = peak * Math.sin(rate * k * step);
    displacement[k] = (peak / rate) * (1 - Math.cos(rate * k * step));
  }
  const found = shock.simulate(parameters, { velocity, displacement }, step, ["force", "dissipated_power"]);
  const last = (samples) => samples.slice(-SAMPLES - 1);
  const force = last(found.force), power = last(found.dissipated_power);
  return {
    velocity: last(velocity), displacement: last(displacement), force, curve: staticCurve(shock, parameters, peak, peak / rate),
    compression: Math.max(...force), rebound: Math.min(...force), width: Math.abs(force[SAMPLES / 2] - force[0]),
    energy: power.slice(1).reduce((sum, value) => sum + value, 0) * step,
  };
}

const dynamometerFigures = (now, before) => [
  ["highest force in compression", "N", now.compression, before.compression],
  ["highest force in rebound", "N", now.rebound, before.rebound],
  ["width of the loop at zero velocity", "N", now.width, before.width],
  ["energy per cycle", "J", now.energy, before.energy],
];

// The quarter car over a bump: a raised cosine, with the tire force over time.

const BUMP_STEP = 1e-3, BEFORE = 0.1, AFTER = 1.4; // [s]
const CAR_OUTPUTS = ["car.tire_force", "car.velocity", "car.wheel_position", "car.chassis_position", "shock.force"];

/** Return the height of the road [m] at each sample. */
function roadOf({ height, length, speed }) {
  const count = Math.round((BEFORE + length / speed + AFTER) / BUMP_STEP) + 1, road = new Float64Array(count);
  for (let k = 0; k < count; k++) {
    const place = speed * (k * BUMP_STEP - BEFORE);
    road[k] = place > 0 && place < length ? (height / 2) * (1 - Math.cos((2 * Math.PI * place) / length)) : 0;
  }
  return road;
}

/** Return the run of a car whose shock has the given parameters, and its figures. */
function bump(car, parameters, question) {
  const road = roadOf(question), found = car.simulate(inCar(parameters), { "car.road": road }, BUMP_STEP, CAR_OUTPUTS);
  const tire = found["car.tire_force"], still = tire[0];
  const squares = tire.reduce((sum, force) => sum + (force - still) ** 2, 0);
  return {
    time: Float64Array.from(road, (_, k) => k * BUMP_STEP), road, tire, velocity: found["car.velocity"],
    wheel: found["car.wheel_position"], chassis: found["car.chassis_position"], shock: found["shock.force"],
    lowest: Math.min(...tire), highest: Math.max(...tire), variation: Math.sqrt(squares / tire.length),
    fastest: found["car.velocity"].reduce((most, v) => Math.max(most, Math.abs(v)), 0),
  };
}

const bumpFigures = (now, before) => [
  ["lowest tire force", "N", now.lowest, before.lowest],
  ["highest tire force", "N", now.highest, before.highest],
  ["tire force variation, RMS", "N", now.variation, before.variation],
  ["highest shock speed", "m/s", now.fastest, before.fastest],
];

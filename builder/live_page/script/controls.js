// Sliders: their values in SI, and as text in the units of the reader.

const STEPS = 1000; // of a slider
const values = {}; // by group, then by name, in SI

const controlOf = (group, name) => models.controls[group].find((control) => control.name === name);
const unitOf = (control) => (metric ? control.si : control.us);

/** Return a value with three significant digits, without an exponent where that is short. */
function digits(value) {
  const size = Math.abs(value);
  return size === 0 ? "0" : size >= 1e5 || size < 1e-3 ? value.toExponential(2) : String(Number(value.toPrecision(3)));
}

const textOfValue = (control, value) => {
  const [unit, factor] = unitOf(control);
  return `${digits(value * factor)}${unit === "1" ? "" : ` ${unit}`}`;
};

/** Return a value in SI with its unit, for one of the page's plain quantities. */
const amount = (unit, value) => textOfValue({ us: models.units[unit].us, si: models.units[unit].si }, value);

function valueAt({ low, high, is_logarithmic }, place) {
  const share = place / STEPS;
  return is_logarithmic ? low * (high / low) ** share : low + (high - low) * share;
}

function placeOf({ low, high, is_logarithmic }, value) {
  return STEPS * (is_logarithmic ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
}

const everyControl = (action) => {
  for (const [group, controls] of Object.entries(models.controls)) for (const control of controls) action(group, control);
};

const elementOf = (group, control, tag) =>
  document.querySelector(`${tag}[data-group="${group}"][data-name="${control.name}"]`);

function showControl(group, control) {
  const output = elementOf(group, control, "output"), value = values[group][control.name];
  output.textContent = textOfValue(control, value);
  output.parentElement.classList.toggle("turned", value !== control.start);
}

/** Set every quantity to its value at the start. */
function resetControls() {
  everyControl((group, control) => {
    (values[group] ??= {})[control.name] = control.start;
    elementOf(group, control, "input").value = placeOf(control, control.start);
    showControl(group, control);
  });
}

/** Call `changed` with the group of a slider that was moved. */
function onControls(changed) {
  everyControl((group, control) => elementOf(group, control, "input").addEventListener("input", (event) => {
    values[group][control.name] = valueAt(control, Number(event.target.value));
    showControl(group, control);
    changed(group);
  }));
}

/** The shock's parameters as they were built. */
const built = () => Object.fromEntries(models.controls.shock.map((control) => [control.name, control.start]));

/** Parameters of the shock with the names that they have in the car. */
const inCar = (parameters) =>
  Object.fromEntries(Object.entries(parameters).map(([name, value]) => [models.prefix + name, value]));

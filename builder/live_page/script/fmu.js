// An FMU: the WebAssembly module of its C code, and its value references by name.

const models = JSON.parse(document.getElementById("models").textContent);

class Fmu {
  static async load(name) {
    const { instance } = await WebAssembly.instantiate(await unpacked(`${name}-module`), {});
    return new Fmu(instance.exports, models[name]);
  }

  constructor(code, references) {
    this.code = code;
    this.references = references;
  }

  /** The last message of the FMU. */
  get message() {
    const bytes = new Uint8Array(this.code.memory.buffer, this.code.page_message());
    return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
  }

  #demand(done, what) {
    if (!done) throw new Error(this.message || `${what} was refused`);
  }

  /** Set variables; `values` has them by name, in SI. */
  set(values) {
    for (const [name, value] of Object.entries(values)) this.#demand(this.code.page_set(this.references[name], value), name);
  }

  get(name) {
    return this.code.page_get(this.references[name]);
  }

  /** Initialize with parameters and inputs; the FMU starts in equilibrium. */
  start(values) {
    this.#demand(this.code.page_open(), "a new instance");
    this.set(values);
    this.#demand(this.code.page_start(), "the start");
    this.time = 0;
  }

  /** Step while inputs change linearly from their values `now` to `next`; both are by name. */
  step(now, next, h) {
    for (const [name, value] of Object.entries(now)) {
      this.#demand(this.code.page_set(this.references[name], value), name);
      this.#demand(this.code.page_slope(this.references[name], (next[name] - value) / h), name);
    }
    this.#demand(this.code.page_step(this.time, h), "a step");
    this.time += h;
  }

  /**
   * Simulate: `inputs` has the samples of each input by name, `step` [s] apart; between them they are linear.
   * Return the samples of `outputs` by name; the first are those of the start.
   */
  simulate(parameters, inputs, step, outputs) {
    const names = Object.keys(inputs), count = inputs[names[0]].length;
    const at = (k) => Object.fromEntries(names.map((name) => [name, inputs[name][k]]));
    const found = Object.fromEntries(outputs.map((name) => [name, new Float64Array(count)]));
    const read = (k) => { for (const name of outputs) found[name][k] = this.get(name); };
    let now = at(0);
    this.start({ ...parameters, ...now });
    read(0);
    for (let k = 1; k < count; k++) {
      const next = at(k);
      this.step(now, next, step);
      now = next;
      read(k);
    }
    return found;
  }
}

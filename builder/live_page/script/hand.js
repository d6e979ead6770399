// The shock moved by hand: the pointer pulls it through a stiff, critically damped spring.

const REACH = 0.05; // [m] from the middle of the pad to its edge
const PULL = 50; // [1/s]
const HAND_STEP = 1e-3, LONGEST = 0.05, TRAIL = 2000; // [s], [s], samples

class Hand {
  constructor(shock, pad, moved) {
    Object.assign(this, { shock, pad, moved, target: 0, position: 0, velocity: 0, trail: [], moves: false });
    pad.addEventListener("pointerdown", (event) => { pad.setPointerCapture(event.pointerId); this.pull(event); });
    pad.addEventListener("pointermove", (event) => { if (event.buttons) this.pull(event); });
    pad.addEventListener("pointerup", () => { this.target = 0; });
    pad.addEventListener("keydown", (event) => {
      const way = { ArrowUp: 1, ArrowDown: -1, Home: 0 }[event.key];
      if (way === undefined) return;
      event.preventDefault();
      this.aim(way === 0 ? 0 : this.target + way * REACH / 4);
    });
  }

  /** Start anew with parameters; the next motion begins an empty trail. */
  restart(parameters) {
    this.parameters = parameters;
    this.trail = [];
    this.isFresh = true;
  }

  pull(event) {
    const box = this.pad.getBoundingClientRect();
    this.aim((1 - (2 * (event.clientY - box.top)) / box.height) * REACH);
  }

  aim(target) {
    this.target = Math.max(-REACH, Math.min(REACH, target));
    if (!this.moves) {
      this.moves = true;
      this.last = performance.now();
      requestAnimationFrame((time) => this.frame(time));
    }
  }

  frame(time) {
    this.advance(Math.min(LONGEST, Math.max(0, (time - this.last) / 1e3)));
    this.last = time;
    const rests = Math.abs(this.target - this.position) < 1e-5 && Math.abs(this.velocity) < 1e-4;
    this.moves = !(rests && this.target === 0);
    this.pad.querySelector("i").style.top = `${50 - (50 * this.position) / REACH}%`;
    this.pad.setAttribute("aria-valuenow", (this.position * 1e3).toFixed(1));
    this.moved(this.trail);
    if (this.moves) requestAnimationFrame((next) => this.frame(next));
  }

  /** Move on by some seconds in steps of HAND_STEP. */
  advance(seconds) {
    if (this.isFresh) this.shock.start({ ...this.parameters, velocity: this.velocity, displacement: this.position });
    this.isFresh = false;
    for (let left = seconds; left > 0; left -= HAND_STEP) {
      const now = { velocity: this.velocity, displacement: this.position };
      const pull = PULL * PULL * (this.target - this.position) - 2 * PULL * this.velocity;
      this.velocity += pull * HAND_STEP;
      this.position += this.velocity * HAND_STEP;
      this.shock.step(now, { velocity: this.velocity, displacement: this.position }, HAND_STEP);
      this.trail.push([this.velocity, this.shock.get("force"), this.position]);
    }
    this.trail = this.trail.slice(-TRAIL);
  }
}

// A problem as the page needs it; see moe_policy/experiments/page/contents.py.

/** A plan in the flat layout as rows of states and controls. */
export function unflattened(flat, knots, nx, nu) {
  const row = (i, width, begin) => Array.from(flat.subarray(begin + i * width, begin + (i + 1) * width));
  return {
    states: Array.from({ length: knots }, (_, i) => row(i, nx, 0)),
    controls: Array.from({ length: knots - 1 }, (_, i) => row(i, nu, knots * nx)),
    duration: flat[flat.length - 1],
  };
}

export class Problem {
  constructor(description) {
    Object.assign(this, description);
    this.nx = this.states.length;
    this.nu = this.controls.length;
  }

  /** Initial state of parameters p. */
  initial(p) {
    const x = [...this.start];
    this.slots.forEach((slot, i) => (x[slot] = p[this.inState[i]]));
    return x;
  }

  context(p) {
    return this.inContext.map((i) => p[i]);
  }

  /** Add the turns of each parameter to the states of a flat plan, in place. */
  shift(flat, turns) {
    this.slots.forEach((slot, i) => {
      const turn = turns[this.inState[i]];
      if (turn) for (let k = 0; k < this.knots; k++) flat[k * this.nx + slot] += turn;
    });
  }

  rows(flat) {
    return unflattened(flat, this.knots, this.nx, this.nu);
  }
}

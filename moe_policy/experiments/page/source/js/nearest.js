// The nearest stored optimum, every parameter divided by the width of its box.

export class Nearest {
  constructor({ total, count, parameters, plans, families }, read, problem) {
    Object.assign(this, { total, count, problem });
    this.parameters = read(parameters);
    this.plans = read(plans);
    this.families = read(families);
  }

  row(p) {
    const width = p.length, boxes = this.problem.parameters.map(({ lower, upper }) => upper - lower);
    let best = 0, least = Infinity;
    for (let row = 0; row < this.count; row++) {
      let sum = 0;
      for (let i = 0; i < width; i++) sum += ((p[i] - this.parameters[row * width + i]) / boxes[i]) ** 2;
      if (sum < least) [best, least] = [row, sum];
    }
    return best;
  }

  /** The stored plan in the flat layout, and its family. */
  plan(p) {
    const row = this.row(p), size = this.plans.length / this.count;
    const flat = Float64Array.from(this.plans.subarray(row * size, (row + 1) * size));
    return { flat, expert: this.families[row] };
  }

  /** Parameters of row number i. */
  at(i) {
    const width = this.problem.parameters.length;
    return Array.from(this.parameters.subarray(i * width, (i + 1) * width));
  }
}

// Everything that is calculated for a problem: the methods' plans, their episodes and verdicts.

import { reader } from "./bytes.js";
import { Nearest } from "./nearest.js";
import { Network } from "./network.js";
import { Problem } from "./problem.js";
import { Simulator, verdict } from "./simulator.js";

/** The methods in the order of the page; dashes tell their lines apart without colour. */
export const METHODS = [
  { id: "snn", name: "single network", dash: [9, 5] },
  { id: "mixture", name: "mixture", dash: [] },
  { id: "nearest", name: "nearest optimum", dash: [2, 5] },
];

export class Model {
  static async of(description) {
    const read = reader(description.block), problem = new Problem(description);
    const { snn, mixture } = description.planners, nearest = new Nearest(description.nearest, read, problem);
    return Object.assign(new Model(), {
      problem,
      nearest,
      snn: new Network(snn, read),
      mixture: new Network(mixture, read),
      simulator: await Simulator.of(read(description.program), problem),
    });
  }

  /** The plan of a method for parameters p, in the flat layout, with the expert or family that it belongs to. */
  plan(id, p) {
    return this[id].plan(p, this.problem);
  }

  /** Plan, episode and verdict of a method. */
  method({ id, name, dash }, p) {
    const { flat, expert } = this.plan(id, p), episode = this.simulator.run(p, flat);
    const color = this.problem.colors[id], plan = this.problem.rows(flat);
    return { id, name, dash, color, flat, expert, plan, episode, verdict: verdict(episode, this.problem) };
  }

  /** Parameters near those of a stored optimum, which are what the problem is about. */
  random() {
    const near = this.nearest.at(Math.floor(Math.random() * this.nearest.count));
    return this.problem.parameters.map(({ lower, upper }, i) => {
      const value = near[i] + 0.1 * (Math.random() - 0.5) * (upper - lower);
      return Math.min(upper, Math.max(lower, value));
    });
  }

  methods(p) {
    return METHODS.map((method) => this.method(method, p));
  }
}

// Episodes in the WebAssembly program of exported regulators and simulator (page/c/episode.c), and their verdicts.

const IMPORTS = {
  env: Object.fromEntries(Object.getOwnPropertyNames(Math).map((name) => [name, Math[name]])),
};
IMPORTS.env.fmod = (x, y) => x % y;

export class Simulator {
  static async of(program, problem) {
    const { instance } = await WebAssembly.instantiate(program, IMPORTS);
    return Object.assign(new Simulator(), { exports: instance.exports, problem });
  }

  array(name, size) {
    return new Float64Array(this.exports.memory.buffer, this.exports[name].value, size);
  }

  /** Track a flat plan from parameters p; the states, controls and what is measured at the control steps. */
  run(p, flat) {
    const { nx, nu, dt, hold, longest } = this.problem, after = Math.round(hold / dt);
    this.array("parameters", p.length).set(p);
    this.array("plan", flat.length).set(flat);
    this.array("states", nx).set(this.problem.initial(p));
    const context = this.problem.context(p);
    this.array("context", context.length).set(context);
    const planned = this.exports.episode(after), steps = Math.min(planned + after, longest);
    const copied = (name, size) => this.array(name, size).slice();
    return {
      planned,
      steps,
      states: copied("states", (steps + 1) * nx),
      controls: copied("controls", steps * nu),
      costs: copied("costs", steps),
      left: copied("left_box", steps),
      errors: copied("errors", steps + 1),
      clearances: copied("least_clearance", steps + 1),
    };
  }
}

/** What moe_policy/rollouts/ledger.py says of an episode. */
export function verdict(episode, { radius, nx, dt, clearances }) {
  const { planned, steps, errors } = episode, out = episode.left.findIndex((value) => value > 0);
  const leaves = out < 0 ? Infinity : out + 1, last = Math.min(steps, leaves), end = Math.min(planned, last);
  const inside = (k) => errors[k] < radius && k !== leaves;
  let entry = 0;
  while (entry <= last && !inside(entry)) entry++;
  const state = (k) => Array.from(episode.states.subarray(k * nx, (k + 1) * nx));
  return {
    atEnd: inside(end),
    error: errors[end],
    endState: state(end),
    success: inside(last),
    finalError: errors[last],
    finalState: state(last),
    cost: episode.costs.subarray(0, Math.min(entry, last)).reduce((sum, cost) => sum + cost, 0),
    duration: planned * dt,
    clearance: clearances ? Math.min(...episode.clearances.subarray(0, last + 1)) : null,
  };
}

// Network planners: what moe_policy/planners/network.py calculates for one instance.

function layersOf(description, read) {
  return description.map(({ inputs, weights, biases }) => ({ inputs, weights: read(weights), biases: read(biases) }));
}

/** Outputs of one layer at x, and of negative ones `slope` times as much. */
function layerAt({ inputs, weights, biases }, slope, x) {
  const outputs = biases.length, y = new Float64Array(outputs);
  for (let o = 0, w = 0; o < outputs; o++) {
    let sum = biases[o];
    for (let i = 0; i < inputs; i++, w++) sum += weights[w] * x[i];
    y[o] = sum < 0 ? slope * sum : sum;
  }
  return y;
}

/** Outputs of a network at x, a Float64Array: matrix products with LeakyReLU between them. */
function forward(layers, slope, x) {
  for (let l = 0; l < layers.length; l++) x = layerAt(layers[l], l < layers.length - 1 ? slope : 1, x);
  return x;
}

export function largest(values) {
  let found = 0;
  for (let i = 1; i < values.length; i++) if (values[i] > values[found]) found = i;
  return found;
}

export class Network {
  constructor(description, read) {
    Object.assign(this, description);
    this.mean = read(description.output_mean);
    this.std = read(description.output_std);
    this.gateLayers = description.gate && layersOf(description.gate, read);
    this.expertLayers = description.experts.map((each) => layersOf(each, read));
  }

  /** Parameters with their angles in the turn around the centre of the box. */
  inOneTurn(p) {
    return p.map((value, i) => {
      if (!this.periodic[i] || (value >= this.first[i] && value < this.end[i])) return value;
      const period = this.period[i], rest = (value - this.low[i]) % period;
      const turned = this.low[i] + (rest < 0 ? rest + period : rest);
      return turned >= this.end[i] ? turned - period : turned;
    });
  }

  inputs(within) {
    return Float64Array.from(within, (value, i) => (value - this.input_mean[i]) / this.input_std[i]);
  }

  /** The gate's outputs c(p), of which the largest belongs to the chosen expert; null for a single network. */
  logits(p) {
    return this.gateLayers && forward(this.gateLayers, this.slope, this.inputs(this.inOneTurn(p)));
  }

  /** The plan in the flat layout, and the index of the chosen expert. */
  plan(p, problem) {
    const within = this.inOneTurn(p), x = this.inputs(within);
    const expert = this.gateLayers ? largest(forward(this.gateLayers, this.slope, x)) : 0;
    const flat = forward(this.expertLayers[expert], this.slope, x);
    for (let j = 0; j < flat.length; j++) flat[j] = flat[j] * this.std[j] + this.mean[j];
    problem.shift(flat, p.map((value, i) => value - within[i]));
    return { flat, expert };
  }
}

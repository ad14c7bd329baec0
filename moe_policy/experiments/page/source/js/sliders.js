// A slider for each parameter: the way to set the initial condition without dragging.

import { quantity, symbol } from "./words.js";

export class Sliders {
  constructor(parent, parameters, changed) {
    this.parameters = parameters;
    this.inputs = parameters.map((parameter, i) => {
      const label = document.createElement("label"), name = document.createElement("span");
      const input = document.createElement("input"), output = document.createElement("output");
      name.textContent = symbol(parameter.name);
      Object.assign(input, { type: "range", min: parameter.lower, max: parameter.upper, step: "any" });
      input.setAttribute("aria-label", `initial ${parameter.name}`);
      input.addEventListener("input", () => changed(i, Number(input.value)));
      input.addEventListener("keydown", (event) => this.key(event, i, changed));
      label.append(name, input, output);
      parent.append(label);
      return { input, output };
    });
  }

  /** Arrow keys move by a fiftieth of the range; browsers differ where a slider has no step. */
  key(event, i, changed) {
    const sign = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
    if (!sign) return;
    event.preventDefault();
    const { lower, upper } = this.parameters[i], value = Number(this.inputs[i].input.value);
    changed(i, Math.min(upper, Math.max(lower, value + (sign * (upper - lower)) / (event.shiftKey ? 500 : 100))));
  }

  show(p) {
    this.inputs.forEach(({ input, output }, i) => {
      input.value = String(p[i]);
      output.textContent = quantity(p[i], this.parameters[i]);
      input.setAttribute("aria-valuetext", output.textContent);
    });
  }
}

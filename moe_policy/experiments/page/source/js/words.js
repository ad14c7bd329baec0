// Verdicts in words and in the table.

const digits = (value, count = 3) => {
  if (value === null || !Number.isFinite(value)) return "–";
  const places = Math.max(0, count - 1 - Math.floor(Math.log10(Math.max(Math.abs(value), 1e-3))));
  return value.toFixed(Math.min(places, 3)).replace("-", "−");
};

/** A cell of the table with its content, and a class. */
function cell(row, content, kind = "td", name = "") {
  const made = document.createElement(kind);
  if (kind === "th") made.scope = "row";
  made.className = name;
  made.append(content);
  row.append(made);
}

function swatch({ color, dash, name }) {
  const label = document.createElement("span");
  const line = `<line x1="1" y1="5" x2="25" y2="5" stroke="${color}" stroke-width="3" stroke-dasharray="${dash.join(" ")}" stroke-linecap="round"/>`;
  label.className = "swatch";
  label.innerHTML = `<svg width="26" height="10" aria-hidden="true">${line}</svg>`;
  label.append(name);
  return label;
}

/** Whether a method reaches the goal, as a sign in its button. */
export function mark(element, { atEnd }) {
  element.textContent = atEnd ? "✓" : "✗";
  element.className = atEnd ? "good" : "bad";
  element.setAttribute("aria-label", atEnd ? ", reaches the goal" : ", misses the goal");
}

/** Write the table of verdicts, one row for each method. */
export function fill(body, methods, problem) {
  body.replaceChildren(...methods.map((method) => {
    const row = document.createElement("tr"), { verdict } = method;
    cell(row, swatch(method), "th");
    cell(row, verdict.atEnd ? "✓ yes" : "✗ no", "td", verdict.atEnd ? "good" : "bad");
    cell(row, digits(verdict.error));
    cell(row, digits(verdict.cost));
    cell(row, verdict.duration.toFixed(2));
    if (problem.clearances) cell(row, digits(verdict.clearance), "td", verdict.clearance < -0.01 ? "bad" : "");
    return row;
  }));
}

/** One sentence for each method. */
export function sentence(methods, families) {
  return methods.map(({ id, name, verdict, expert }) => {
    const outcome = verdict.atEnd ? "reaches the goal" : "misses the goal";
    const subject = {
      snn: `The ${name}`,
      mixture: `The ${name} chooses “${families[expert].long}” and`,
      nearest: `The ${name}, which belongs to another initial condition,`,
    }[id];
    return `${subject} ${outcome} (error ${digits(verdict.error)}, cost ${digits(verdict.cost)}).`;
  }).join(" ");
}

/** The value of a parameter with its unit. */
export const quantity = (value, { unit }) => `${value.toFixed(2).replace("-", "−")} ${unit}`;

const GREEK = { theta: "θ", omega: "ω" };
export const symbol = (name) => GREEK[name] ?? name;
export { swatch };

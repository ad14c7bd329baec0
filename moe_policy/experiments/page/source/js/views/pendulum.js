// What the page shows of the pendulum.

import { polyline, text, ticks, turns } from "../canvas.js";

const GOALS = [[-Math.PI, "upright, θ = −π"], [Math.PI, "upright, θ = π"], [3 * Math.PI, "upright, θ = 3π"]];

function rod(g, place, theta, color, width, dash) {
  const [x, y] = [place.x + place.length * Math.sin(theta), place.y + place.length * Math.cos(theta)];
  Object.assign(g, { strokeStyle: color, fillStyle: color, lineWidth: width });
  g.setLineDash(dash);
  polyline(g, [[place.x, place.y], [x, y]]);
  g.stroke();
  g.setLineDash([]);
  g.beginPath();
  g.arc(x, y, 5 + width, 0, 2 * Math.PI);
  g.fill();
}

/** The tip of the rod over the last second. */
function trail(g, place, thetas, color) {
  Object.assign(g, { strokeStyle: color, lineWidth: 2, globalAlpha: 0.35 });
  polyline(g, thetas.map((theta, i) => {
    const radius = place.length + 12 + (i / thetas.length) * 4;
    return [place.x + radius * Math.sin(theta), place.y + radius * Math.cos(theta)];
  }));
  g.stroke();
  g.globalAlpha = 1;
}

export const PENDULUM = {
  file: "pendulum",
  title: "Pendulum",
  task: "Swing a pendulum up and stop it upright. Its motor is too weak to lift it directly, so from most initial conditions it has to swing to one side first: which side is best changes abruptly.",
  initial: [2.7, -0.55],
  sweep: { from: [2.2, -0.55], to: [3.2, -0.55] },
  mapHint: "Drag the point. Small dots show the family of stored optima.",
  sceneHint: "Drag the pendulum to another initial angle.",
  map: {
    x: 0,
    y: 1,
    xName: "initial angle θ, rad (0 hangs, π is upright)",
    yName: "initial speed ω, rad/s",
    xTicks: (range) => turns(range, 0.5),
    yTicks: (range) => ticks(range, 4),
    families: [
      { short: "ends at −π", long: "swing over to θ = −π", color: "#0072b2" },
      { short: "ends at π", long: "swing up to θ = π", color: "#e69f00" },
      { short: "ends at 3π", long: "swing over to θ = 3π", color: "#7b5aa6" },
    ],
    dots: true,
  },
  chart: {
    panels: [
      {
        index: 0,
        weight: 2.2,
        name: "angle θ, rad",
        range: () => [-1.6 * Math.PI, 3.3 * Math.PI],
        ticks: (range) => turns(range),
        goals: () => GOALS,
      },
      { index: 0, control: true, name: "torque u, N m", range: () => [-1.15, 1.15], ticks: () => [[-1, "−1"], [0, "0"], [1, "1"]] },
    ],
  },
  scene(g, { width, height, colors, methods, problem, time }) {
    const place = { x: width / 2, y: height / 2, length: Math.min(width, height) / 2 - 44 };
    Object.assign(g, { strokeStyle: colors.line, lineWidth: 1 });
    g.beginPath();
    g.arc(place.x, place.y, place.length, 0, 2 * Math.PI);
    g.stroke();
    text(g, "goal", place.x, place.y - place.length - 32, colors.soft);
    g.fillStyle = colors.soft;
    g.beginPath();
    g.arc(place.x, place.y - place.length, 3, 0, 2 * Math.PI);
    g.fill();
    const order = ["nearest", "snn", "mixture"].map((id) => methods.find((each) => each.id === id)).filter(Boolean);
    for (const { episode, color, id, dash } of order) {
      const k = Math.min(Math.round(time / problem.dt), episode.steps), from = Math.max(0, k - 50);
      const thetas = Array.from({ length: k - from + 1 }, (_, i) => episode.states[(from + i) * problem.nx]);
      trail(g, place, thetas, color);
      rod(g, place, thetas[thetas.length - 1], color, id === "nearest" ? 2.5 : 4, dash);
    }
    g.fillStyle = colors.ink;
    g.beginPath();
    g.arc(place.x, place.y, 4, 0, 2 * Math.PI);
    g.fill();
  },
  /** The parameters after the pointer was dragged to a pixel of the scene. */
  dragged(p, [u, v], { width, height }) {
    const theta = Math.atan2(u - width / 2, v - height / 2);
    return [(theta + 2 * Math.PI) % (2 * Math.PI), p[1]];
  },
};

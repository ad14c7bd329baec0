// What the page shows of the ground vehicle.

import { axes, polyline, scale, text, ticks, turns } from "../canvas.js";

const WAYS = { backwards: "arrives in reverse", forwards: "arrives forwards" };
const BENDS = ["turning left", "turning little", "turning right"];
const SHADES = ["#0072b2", "#56b4e9", "#e69f00", "#999999", "#7b5aa6", "#882255"];

const FAMILIES = BENDS.flatMap((bend, i) => Object.entries(WAYS).map(([way, words], j) => ({
  short: `${["left", "direct", "right"][i]},\n${way}`,
  long: `${bend}, ${words}`,
  color: SHADES[2 * i + j],
})));

/** The outline of the vehicle at a state, from above; the nose is a wedge. */
function body(g, x, y, [px, py, theta], size, color) {
  const at = (ahead, right) => [
    x(px) + size * (ahead * Math.sin(theta) + right * Math.cos(theta)),
    y(py) - size * (ahead * Math.cos(theta) - right * Math.sin(theta)),
  ];
  const corners = [[-0.9, -0.5], [0.5, -0.5], [0.9, 0], [0.5, 0.5], [-0.9, 0.5]].map(([a, b]) => at(a, b));
  Object.assign(g, { strokeStyle: color, fillStyle: color, lineWidth: 2 });
  polyline(g, corners);
  g.closePath();
  g.globalAlpha = 0.3;
  g.fill();
  g.globalAlpha = 1;
  g.stroke();
}

function goal(g, x, y, size, colors) {
  g.setLineDash([3, 3]);
  body(g, x, y, [0, 0, 0], size, colors.ink);
  g.setLineDash([]);
}

const places = ({ episode }, problem, until) =>
  Array.from({ length: until + 1 }, (_, k) => Array.from(episode.states.subarray(k * problem.nx, k * problem.nx + 3)));

function path(g, x, y, rows, color, dash, width) {
  Object.assign(g, { strokeStyle: color, lineWidth: width });
  g.setLineDash(dash);
  polyline(g, rows.map(([px, py]) => [x(px), y(py)]));
  g.stroke();
  g.setLineDash([]);
}

/** The middle and half the width of a square view that shows all points. */
function view(points) {
  const xs = points.map(([x]) => x), ys = points.map(([, y]) => y);
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  return { x: (left + right) / 2, y: (low + high) / 2, width: right - left + 4, height: high - low + 4 };
}

export const VEHICLE = {
  file: "vehicle",
  title: "Vehicle",
  task: "Drive a vehicle to the middle of the map and stop there, facing up. It turns only while it moves: it may drive forwards or in reverse, and turn left or right on the way, and which is best changes abruptly.",
  initial: [0.3, 8.5, -0.8, 1],
  sweep: { from: [-1.5, 8.5, -0.8, 1], to: [3.5, 8.5, -0.8, 1] },
  mapHint: "Drag the vehicle to another place, and its nose to another heading.",
  sceneHint: "The dashed vehicle is the goal.",
  map: {
    x: 0,
    y: 1,
    nodes: 61,
    aspect: 0.98,
    equal: true,
    arm: { index: 2, length: 44 },
    xName: "initial x, m",
    yName: "initial y, m",
    xTicks: (range) => ticks(range, 5),
    yTicks: (range) => ticks(range, 5),
    families: FAMILIES,
    over(g, { x, y, colors, p, methods, problem }) {
      goal(g, x, y, 13, colors);
      for (const method of methods) path(g, x, y, places(method, problem, method.episode.planned), method.color, method.dash, 2.4);
      body(g, x, y, p, 17, colors.ink);
    },
  },
  chart: {
    panels: [
      {
        index: 2,
        weight: 1.7,
        name: "heading θ, rad",
        range: () => [-2.7 * Math.PI, 2.7 * Math.PI],
        ticks: (range) => turns(range),
        goals: () => [[-2 * Math.PI, "facing up, θ = −2π"], [0, "facing up, θ = 0"], [2 * Math.PI, "facing up, θ = 2π"]],
      },
      {
        index: 3,
        name: "speed v, m/s",
        range: (values) => [Math.min(-2, ...values) - 0.5, Math.max(2, ...values) + 0.5],
        ticks: (range) => ticks(range, 3),
        goals: () => [[0, ""]],
      },
    ],
  },
  scene(g, { width, height, colors, methods, problem, time }) {
    const rows = methods.map((method) => places(method, problem, method.episode.planned));
    const all = view([[0, 0, 0], ...rows.flat()]), box = { left: 34, right: width - 8, top: 14, bottom: height - 40 };
    const size = Math.min((box.right - box.left) / all.width, (box.bottom - box.top) / all.height);
    const half = [(box.right - box.left) / 2 / size, (box.bottom - box.top) / 2 / size];
    const [xs, ys] = [[all.x - half[0], all.x + half[0]], [all.y - half[1], all.y + half[1]]];
    const x = scale(xs, [box.left, box.right]), y = scale(ys, [box.bottom, box.top]);
    axes(g, { x, y, box, xTicks: ticks(xs, 5), yTicks: ticks(ys, 5), xName: "x, y in m", yName: "" }, colors);
    goal(g, x, y, Math.max(12, size), colors);
    methods.forEach((method, i) => path(g, x, y, rows[i], method.color, method.dash, 1.6));
    methods.forEach((method, i) => {
      const k = Math.min(Math.round(time / problem.dt), method.episode.planned);
      body(g, x, y, rows[i][k], Math.max(12, size), method.color);
    });
    if (!methods.length) text(g, "all methods are hidden", width / 2, height / 2, colors.soft);
  },
};

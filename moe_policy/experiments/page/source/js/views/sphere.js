// What the page shows of the quadcopter that flies round a sphere.

import { polyline, text, ticks } from "../canvas.js";
import { attitude, Camera } from "../space.js";

const SHADES = ["#0072b2", "#56b4e9", "#e69f00", "#999999", "#7b5aa6", "#882255", "#44aa99", "#999933"];
/** Names of families are the signs of the components of the vector from the sphere's centre to the path. */
const FAMILIES = ["---", "--+", "-+-", "-++", "+--", "+-+", "++-", "+++"].map((signs, i) => {
  const [x, y, z] = [["west", "east"], ["south", "north"], ["below", "above"]].map((words, k) => words[signs[k] === "+" ? 1 : 0]);
  return { short: `${y}-${x},\n${z}`, long: `pass ${y}-${x} of the centre and ${z} it`, color: SHADES[i] };
});
const camera = new Camera(-0.9, 0.1);
/** The vehicle is drawn larger than it is, since its arms are 0.175 m long. */
const ARM = 0.9;

const states = ({ episode }, problem, last) =>
  Array.from({ length: last + 1 }, (_, k) => Array.from(episode.states.subarray(k * problem.nx, k * problem.nx + 9)));

function disc(g, u, v, radius) {
  const shade = g.createRadialGradient(u - radius / 3, v - radius / 3, radius / 8, u, v, radius);
  shade.addColorStop(0, "#f2f3f5");
  shade.addColorStop(1, "#858b96");
  Object.assign(g, { fillStyle: shade, globalAlpha: 0.82 });
  g.beginPath();
  g.arc(u, v, radius, 0, 2 * Math.PI);
  g.fill();
  g.globalAlpha = 1;
}

function copter(g, to, [x, y, z, , , , phi, theta, psi], color) {
  const rotation = attitude(phi, theta, psi), ends = [[ARM, 0], [0, ARM], [-ARM, 0], [0, -ARM]];
  const hubs = ends.map(([a, b]) => to([x, y, z].map((value, i) => value + rotation[i][0] * a + rotation[i][1] * b)));
  Object.assign(g, { strokeStyle: color, fillStyle: color, lineWidth: 3 });
  for (const [one, other] of [[0, 2], [1, 3]]) polyline(g, [hubs[one], hubs[other]]), g.stroke();
  for (const [u, v] of hubs) {
    g.beginPath();
    g.arc(u, v, 4, 0, 2 * Math.PI);
    g.fill();
  }
}

/** The plane of the goal as a grid, seen from above or from below. */
function ground(g, to, colors) {
  Object.assign(g, { strokeStyle: colors.line, lineWidth: 1 });
  for (let k = -10; k <= 10; k += 5)
    for (const line of [[[k, -10, 0], [k, 10, 0]], [[-10, k, 0], [10, k, 0]]]) polyline(g, line.map(to)), g.stroke();
}

const distance = ([x, y, z], p) => Math.hypot(x - p[3], y - p[4], z - p[5]) - p[6];

export const SPHERE = {
  file: "sphere",
  title: "Quadcopter",
  task: "Fly a quadcopter from rest to rest round a sphere that blocks the way. It may pass on any side, and which is best changes abruptly; but sides are close to each other in cost and shape, and the single network does nearly as well as the mixture.",
  initial: [6.43, 5.78, -4.68, 2.11, 3.1, 0.12, 2.76],
  sweep: { from: [2.43, 5.78, -4.68, 2.11, 3.1, 0.12, 2.76], to: [10, 5.78, -4.68, 2.11, 3.1, 0.12, 2.76] },
  mapHint: "Drag the point: it is the initial position seen from above, the disc is the sphere, and the cross the goal.",
  verdictHint: "The clearance is the smallest distance from the sphere, negative inside it.",
  sceneHint: "Drag the picture, or use the arrow keys, to look from another side. The vehicle is drawn five times its size.",
  camera,
  map: {
    x: 0,
    y: 1,
    nodes: 41,
    aspect: 0.98,
    equal: true,
    xName: "initial x, m",
    yName: "initial y, m",
    xTicks: (range) => ticks(range, 5),
    yTicks: (range) => ticks(range, 5),
    families: FAMILIES,
    over(g, { x, y, colors, p, methods, problem }) {
      disc(g, x(p[3]), y(p[4]), x(p[6]) - x(0));
      text(g, "+", x(0), y(0), colors.ink, { font: "20px system-ui", halo: colors.surface });
      for (const method of methods) {
        Object.assign(g, { strokeStyle: method.color, lineWidth: 2.4 });
        g.setLineDash(method.dash);
        polyline(g, states(method, problem, method.episode.planned).map(([px, py]) => [x(px), y(py)]));
        g.stroke();
        g.setLineDash([]);
      }
    },
  },
  chart: {
    panels: [
      {
        weight: 1.6,
        name: "distance from the sphere, m",
        traces: ({ plan, episode }, p) => ({
          planned: plan.states.map((state) => distance(state, p)),
          followed: Array.from(episode.clearances.subarray(0, episode.planned + 1)),
        }),
        range: (values) => [Math.min(-0.5, ...values), Math.max(2, ...values)],
        ticks: (range) => ticks(range, 4),
        goals: () => [[0, "surface of the sphere"]],
      },
      { index: 2, name: "height z, m", range: (values) => [Math.min(-1, ...values), Math.max(1, ...values)], ticks: (range) => ticks(range, 3), goals: () => [[0, "goal"]] },
    ],
  },
  scene(g, { width, height, colors, methods, problem, time, p }) {
    const rows = methods.map((method) => states(method, problem, method.episode.planned)), r = p[6];
    const around = (center, a) => [-a, a].flatMap((b) => [0, 1, 2].map((k) => center.map((value, i) => value + (i === k ? b : 0))));
    const shown = [...around(p.slice(3, 6), r), ...around(p.slice(0, 3), ARM), ...around([0, 0, 0], ARM), ...rows.flat()];
    const to = camera.fitted(shown, width, height, 34);
    ground(g, to, colors);
    const [u, v, depth] = to(p.slice(3, 6)), hidden = ([a, b, d]) => d < depth && Math.hypot(a - u, b - v) < r * to.size;
    const lines = methods.map(({ color, dash }, i) => ({ color, dash, points: rows[i].map(to) }));
    const draw = (behind) => {
      for (const { color, dash, points } of lines) {
        Object.assign(g, { strokeStyle: color, lineWidth: 2.2 });
        g.setLineDash(dash);
        g.beginPath();
        points.forEach(([a, b], k) => (k && hidden(points[k]) === behind ? g.lineTo(a, b) : g.moveTo(a, b)));
        g.stroke();
        g.setLineDash([]);
      }
    };
    draw(true);
    disc(g, u, v, r * to.size);
    draw(false);
    text(g, "+", ...to([0, 0, 0]).slice(0, 2), colors.ink, { font: "22px system-ui", halo: colors.surface });
    text(g, "goal", to([0, 0, 0])[0], to([0, 0, 0])[1] + 16, colors.ink, { halo: colors.surface });
    methods.forEach((method, i) => {
      copter(g, to, rows[i][Math.min(Math.round(time / problem.dt), method.episode.planned)], method.color);
    });
  },
};

// Plans over time: one panel for each coordinate that the view names; knots as dots, the tracked episode as a thin line.

import { axes, polyline, prepared, scale, text, theme, ticks } from "./canvas.js";

const MARGIN = { left: 46, right: 14, top: 28, bottom: 42, between: 40 };

/** The rows `values` (each an array of width entries) at one index. */
const column = (values, width, index) => Array.from({ length: values.length / width }, (_, k) => values[k * width + index]);

export class Chart {
  constructor(canvas, view) {
    Object.assign(this, { canvas, view });
  }

  draw(methods, time, problem, p) {
    const { g, width, height } = prepared(this.canvas), colors = theme(), { panels } = this.view;
    const longest = Math.max(1, ...methods.map(({ plan }) => plan.duration));
    const share = (height - MARGIN.top - MARGIN.bottom - MARGIN.between * (panels.length - 1)) / panels.reduce((sum, { weight = 1 }) => sum + weight, 0);
    const x = scale([0, longest * 1.04], [MARGIN.left, width - MARGIN.right]);
    let top = MARGIN.top;
    panels.forEach((panel, i) => {
      const box = { left: MARGIN.left, right: width - MARGIN.right, top, bottom: top + share * (panel.weight ?? 1) };
      const last = i === panels.length - 1;
      this.panel(g, panel, { box, x, methods, problem, colors, xTicks: ticks([0, longest * 1.04], width < 420 ? 4 : 7), last, time, p });
      top = box.bottom + MARGIN.between;
    });
  }

  panel(g, panel, { box, x, methods, problem, colors, xTicks, last, time, p }) {
    const of = panel.traces ?? ((method) => this.coordinate(method, panel, problem));
    const traces = methods.map((method) => ({ ...method, ...of(method, p) }));
    const range = panel.range(traces.flatMap(({ planned, followed }) => [...planned, ...followed]));
    const y = scale(range, [box.bottom, box.top]), bands = panel.goals?.(range) ?? [];
    const words = last ? xTicks : xTicks.map(([value]) => [value, ""]);
    axes(g, { x, y, box, xTicks: words, yTicks: panel.ticks(range), xName: last ? "time, s" : "", yName: panel.name }, colors);
    for (const [value, name] of bands) {
      Object.assign(g, { strokeStyle: colors.soft, lineWidth: 1.2 });
      polyline(g, [[box.left, y(value)], [box.right, y(value)]]);
      g.stroke();
      text(g, name, box.right, y(value) + (value < 0 ? 9 : -8), colors.soft, { align: "right", halo: colors.surface });
    }
    g.save();
    g.beginPath();
    g.rect(box.left - 4, box.top - 6, box.right - box.left + 8, box.bottom - box.top + 12);
    g.clip();
    for (const trace of traces) this.trace(g, trace, x, y, panel.control, problem.dt);
    g.restore();
    Object.assign(g, { strokeStyle: colors.ink, lineWidth: 1 });
    polyline(g, [[x(time), box.top], [x(time), box.bottom]]);
    if (x(time) <= box.right) g.stroke();
  }

  /** The values of a state or control, planned at the knots and followed at the control steps. */
  coordinate({ plan, episode }, { control, index }, { nx, nu }) {
    const of = control ? "controls" : "states", steps = episode.planned + (control ? 0 : 1);
    return {
      planned: plan[of].map((row) => row[index]),
      followed: column(episode[of], control ? nu : nx, index).slice(0, steps),
    };
  }

  trace(g, { planned, followed, plan, color, dash }, x, y, stepped, dt) {
    const step = plan.duration / (plan.states.length - 1);
    const points = planned.flatMap((value, k) => {
      const here = [[x(k * step), y(value)]];
      return stepped ? [...here, [x((k + 1) * step), y(value)]] : here;
    });
    Object.assign(g, { strokeStyle: color, lineWidth: 1, globalAlpha: 0.7 });
    polyline(g, followed.map((value, k) => [x(k * dt), y(value)]));
    g.stroke();
    Object.assign(g, { lineWidth: 2.6, globalAlpha: 1 });
    g.setLineDash(dash);
    polyline(g, points);
    g.stroke();
    g.setLineDash([]);
    const [endX, endY] = points[points.length - 1];
    g.fillStyle = color;
    g.beginPath();
    g.arc(endX, endY, 4, 0, 2 * Math.PI);
    g.fill();
  }
}

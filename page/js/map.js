// The map of initial conditions: regions of the gate's choice, their borders, stored optima and the point to drag.

import { axes, polyline, prepared, scale, text, theme } from "./canvas.js";
import { borders, choices, gridOf, labels } from "./regions.js";

const MARGIN = { left: 40, right: 14, top: 26, bottom: 40 }, NODES = 81;

/** A colour #rrggbb as [r, g, b]. */
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

export class RegionMap {
  /** `view` says which parameters are x and y, how axes and regions are named, and what is drawn over the regions. */
  constructor(canvas, model, view) {
    Object.assign(this, { canvas, model, view, key: null });
  }

  geometry(width, height) {
    const box = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
    const range = (i) => [this.model.problem.parameters[i].lower, this.model.problem.parameters[i].upper];
    const [xs, ys] = [range(this.view.x), range(this.view.y)];
    return { box, x: scale(xs, [box.left, box.right]), y: scale(ys, [box.bottom, box.top]), xs, ys };
  }

  /** Parameters with those of the map at a pixel of the canvas. */
  at(p, pixel) {
    const { x, y, xs, ys } = this.geometry(this.canvas.clientWidth, this.canvas.clientHeight), found = [...p];
    found[this.view.x] = Math.min(xs[1], Math.max(xs[0], x.back(pixel[0])));
    found[this.view.y] = Math.min(ys[1], Math.max(ys[0], y.back(pixel[1])));
    return found;
  }

  pixel(p) {
    const { x, y } = this.geometry(this.canvas.clientWidth, this.canvas.clientHeight);
    return [x(p[this.view.x]), y(p[this.view.y])];
  }

  /** Regions and borders, which stay as long as neither the other parameters nor the size change. */
  regions(p, { xs, ys, box }, colors) {
    const others = p.filter((_, i) => i !== this.view.x && i !== this.view.y);
    const width = Math.round(box.right - box.left), height = Math.round(box.bottom - box.top);
    const key = JSON.stringify([others, width, height, colors.map]);
    if (key === this.key) return this.kept;
    const logits = (x, y) => {
      const at = [...p];
      [at[this.view.x], at[this.view.y]] = [x, y];
      return this.model.mixture.logits(at);
    };
    const grid = gridOf(logits, { x: xs, y: ys }, this.view.nodes ?? NODES, this.view.nodes ?? NODES);
    const found = choices(grid, width, height);
    this.key = key;
    this.kept = { picture: this.picture(found, width, height, Number(colors.map)), lines: borders(grid) };
    return Object.assign(this.kept, { names: labels(found, width, height) });
  }

  picture(found, width, height, strength) {
    const made = Object.assign(document.createElement("canvas"), { width, height }), g = made.getContext("2d");
    const image = g.createImageData(width, height), tints = this.view.families.map(({ color }) => rgb(color));
    found.forEach((expert, k) => image.data.set([...tints[expert], 255 * strength], 4 * k));
    g.putImageData(image, 0, 0);
    return made;
  }

  draw(p, plans, time) {
    const { g, width, height } = prepared(this.canvas), colors = theme(), place = this.geometry(width, height);
    const { box, x, y } = place, { picture, lines, names } = this.regions(p, place, colors);
    g.drawImage(picture, box.left, box.top, box.right - box.left, box.bottom - box.top);
    const [xTicks, yTicks] = [this.view.xTicks(place.xs), this.view.yTicks(place.ys)];
    axes(g, { x, y, box, xTicks, yTicks, xName: this.view.xName, yName: this.view.yName }, colors);
    this.view.dots && this.dots(g, x, y);
    Object.assign(g, { strokeStyle: colors.ink, lineWidth: 1.6 });
    g.setLineDash([6, 5]);
    for (const line of lines) {
      polyline(g, line.map(([u, v]) => [box.left + u * picture.width, box.bottom - v * picture.height]));
      g.stroke();
    }
    g.setLineDash([]);
    for (const { expert, size, u, v } of names)
      if (size > 36) this.name(g, this.view.families[expert].short, box.left + u, box.top + v, colors);
    this.view.over?.(g, { x, y, box, colors, p, plans, time });
    this.handle(g, x(p[this.view.x]), y(p[this.view.y]), colors);
  }

  name(g, words, x, y, colors) {
    words.split("\n").forEach((line, i, all) =>
      text(g, line, x, y + (i - (all.length - 1) / 2) * 15, colors.ink, { halo: colors.surface }));
  }

  dots(g, x, y) {
    const { nearest } = this.model;
    for (let i = 0; i < nearest.count; i++) {
      const at = nearest.at(i);
      g.fillStyle = this.view.families[nearest.families[i]].color;
      g.globalAlpha = 0.65;
      g.fillRect(x(at[this.view.x]) - 1.2, y(at[this.view.y]) - 1.2, 2.4, 2.4);
    }
    g.globalAlpha = 1;
  }

  handle(g, x, y, colors) {
    const ring = (radius, color) => {
      g.beginPath();
      g.arc(x, y, radius, 0, 2 * Math.PI);
      g.fillStyle = color;
      g.fill();
    };
    ring(11, colors.surface);
    ring(9, colors.ink);
    ring(3.5, colors.surface);
  }
}

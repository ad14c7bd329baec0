// The map of initial conditions: regions of the gate's choice, their borders, stored optima and the point to drag.

import { axes, polyline, prepared, scale, text, theme } from "./canvas.js";
import { borders, choices, gridOf, labels } from "./regions.js";

const MARGIN = { left: 40, right: 14, top: 26, bottom: 40 }, NODES = 81;

/** Narrow a box to `ratio` times as wide as it is high, so that directions are true. */
function square(box, ratio) {
  const width = box.right - box.left, height = box.bottom - box.top;
  const inset = [Math.max(0, width - height * ratio) / 2, Math.max(0, height - width / ratio) / 2];
  Object.assign(box, { left: box.left + inset[0], right: box.right - inset[0], top: box.top + inset[1], bottom: box.bottom - inset[1] });
}

/** A colour #rrggbb as [r, g, b]. */
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

export class RegionMap {
  /** `view` says which parameters are x and y, how axes and regions are named, and what is drawn over the regions. */
  constructor(canvas, model, view) {
    Object.assign(this, { canvas, model, view, key: null });
    canvas.style.aspectRatio = view.aspect;
  }

  geometry(width, height) {
    const box = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
    const range = (i) => [this.model.problem.parameters[i].lower, this.model.problem.parameters[i].upper];
    const [xs, ys] = [range(this.view.x), range(this.view.y)];
    if (this.view.equal) square(box, (xs[1] - xs[0]) / (ys[1] - ys[0]));
    return { box, x: scale(xs, [box.left, box.right]), y: scale(ys, [box.bottom, box.top]), xs, ys };
  }

  /** The end of the arm that shows the direction of a parameter, from the y axis on. */
  armEnd(p) {
    const [x, y] = this.pixel(p), { index, length } = this.view.arm;
    return [x + length * Math.sin(p[index]), y - length * Math.cos(p[index])];
  }

  onArm(p, pixel) {
    return Boolean(this.view.arm) && Math.hypot(...this.armEnd(p).map((value, i) => value - pixel[i])) < 22;
  }

  /** Parameters with the arm towards a pixel. */
  turned(p, pixel) {
    const [x, y] = this.pixel(p), found = [...p];
    found[this.view.arm.index] = Math.atan2(pixel[0] - x, y - pixel[1]);
    return found;
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
    const image = g.createImageData(width, height), pixels = new Uint32Array(image.data.buffer);
    const tints = this.view.families.map(({ color }) => {
      const [red, green, blue] = rgb(color);
      return new Uint32Array(new Uint8ClampedArray([red, green, blue, 255 * strength]).buffer)[0];
    });
    for (let k = 0; k < pixels.length; k++) pixels[k] = tints[found[k]];
    g.putImageData(image, 0, 0);
    return made;
  }

  draw(p, methods) {
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
    this.view.over?.(g, { x, y, colors, p, methods, problem: this.model.problem });
    for (const { expert, size, u, v } of names)
      if (size > 36) this.name(g, this.view.families[expert].short, box.left + u, box.top + v, colors);
    if (this.view.arm) this.arm(g, p, colors);
    else this.handle(g, ...this.pixel(p), colors);
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

  arm(g, p, colors) {
    const end = this.armEnd(p);
    Object.assign(g, { strokeStyle: colors.ink, lineWidth: 1.5 });
    polyline(g, [this.pixel(p), end]);
    g.stroke();
    this.handle(g, ...end, colors);
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

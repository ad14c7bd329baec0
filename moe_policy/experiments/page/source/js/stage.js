// One problem on the page: its map, chart, scene, table and controls, and what happens when the initial condition moves.

import { prepared, theme } from "./canvas.js";
import { Chart } from "./chart.js";
import { draggable, movable } from "./drag.js";
import { RegionMap } from "./map.js";
import { Player } from "./player.js";
import { Sliders } from "./sliders.js";
import { fill, mark, sentence, swatch } from "./words.js";

const CALM = matchMedia("(prefers-reduced-motion: reduce)");
/** Milliseconds without a change after which the verdict is read out. */
const SPOKEN_AFTER = 600;

export class Stage {
  /** `root` is an element made of the page's template. */
  constructor(root, model, view) {
    const part = (name) => root.querySelector(`[data-part="${name}"]`);
    Object.assign(this, { root, part, model, view, hidden: new Set(), marks: new Map() });
    this.map = new RegionMap(part("map"), model, view.map);
    this.chart = new Chart(part("chart"), view.chart);
    this.player = new Player(part("play"), part("time"), part("seconds"), () => this.paint());
    this.sliders = new Sliders(part("sliders"), model.problem.parameters, (i, value) => this.move(this.p.map((old, k) => (k === i ? value : old))));
    for (const name of ["task", "mapHint", "sceneHint", "verdictHint"]) part(name).textContent = view[name] ?? "";
    part("clearance").hidden = !model.problem.clearances;
    part("stored").textContent = `${model.nearest.count} of ${model.nearest.total}`;
    this.legend();
    this.listen();
    this.set(view.initial);
    this.player.toggle(!CALM.matches);
  }

  listen() {
    const { part, map, view } = this, scene = part("scene");
    let turning = false;
    draggable(part("map"), (pixel, first) => {
      if (first) turning = map.onArm(this.p, pixel);
      this.move(turning ? map.turned(this.p, pixel) : map.at(this.p, pixel));
    });
    movable(part("map"), ([dx, dy]) => {
      const [x, y] = map.pixel(this.p);
      this.move(map.at(this.p, [x + dx, y + dy]));
    });
    const size = () => ({ width: scene.clientWidth, height: scene.clientHeight });
    if (view.camera) this.turnable(scene);
    if (view.dragged) draggable(scene, (pixel, first) => this.move(view.dragged(this.p, pixel, size())));
    part("sweep").addEventListener("click", () => this.sweep());
    part("random").addEventListener("click", () => this.move(this.model.random()));
    new ResizeObserver(() => this.paint()).observe(this.root);
  }

  /** Let the reader turn the picture of space, by dragging or with the arrow keys. */
  turnable(scene) {
    const turn = (dx, dy) => {
      this.view.camera.turn(dx, dy);
      this.paint();
    };
    let before = null;
    scene.tabIndex = 0;
    scene.setAttribute("role", "application");
    draggable(scene, (pixel, first) => {
      if (!first) turn(pixel[0] - before[0], pixel[1] - before[1]);
      before = pixel;
    });
    movable(scene, ([dx, dy]) => turn(5 * dx, 5 * dy));
  }

  /** Buttons that show and hide the methods. */
  legend() {
    for (const method of this.model.methods(this.view.initial)) {
      const button = document.createElement("button");
      button.type = "button";
      const mark = document.createElement("b");
      button.append(swatch(method), mark);
      this.marks.set(method.id, mark);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        const shown = button.getAttribute("aria-pressed") === "false";
        button.setAttribute("aria-pressed", String(shown));
        this.hidden[shown ? "delete" : "add"](method.id);
        this.paint();
      });
      this.part("legend").append(button);
    }
  }

  /** Move the initial condition to parameters p, as the reader asks. */
  move(p) {
    this.ticket = null;
    this.set(p);
  }

  /** Show everything from the initial condition of parameters p. */
  set(p) {
    this.p = p;
    this.methods = this.model.methods(p);
    const { problem } = this.model, ends = this.methods.map(({ episode }) => episode.planned * problem.dt);
    this.player.until(Math.max(...ends) + 1);
    this.sliders.show(p);
    fill(this.part("verdicts"), this.methods, problem);
    for (const { id, verdict } of this.methods) mark(this.marks.get(id), verdict);
    this.paint();
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.speak(), SPOKEN_AFTER);
  }

  speak() {
    this.part("words").textContent = sentence(this.methods, this.view.map.families);
  }

  /** Move the initial condition across a discontinuity and back, within some seconds. */
  sweep() {
    const { from, to } = this.view.sweep, began = performance.now(), ticket = (this.ticket = {});
    const step = (now) => {
      const share = Math.min(1, Math.max(0, now - began) / (CALM.matches ? 1 : 5000));
      if (this.ticket !== ticket) return;
      const along = (1 - Math.cos(2 * Math.PI * share * 0.5)) / 2;
      this.set(from.map((value, i) => value + along * (to[i] - value)));
      if (share < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Draw everything in the next frame. */
  paint() {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  draw() {
    if (!this.root.clientWidth || !this.methods) return;
    const methods = this.methods.filter(({ id }) => !this.hidden.has(id)), { problem } = this.model, { time } = this.player;
    this.map.draw(this.p, methods);
    this.chart.draw(methods, time, problem, this.p);
    const { g, width, height } = prepared(this.part("scene"));
    this.view.scene(g, { width, height, colors: theme(), methods, problem, time, p: this.p });
  }
}

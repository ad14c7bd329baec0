// Canvases at the resolution of the screen, and axes on them.

/** Size a canvas to its place on the page; its context, in CSS pixels, with its width and height. */
export function prepared(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2), { clientWidth: width, clientHeight: height } = canvas;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  g.lineJoin = g.lineCap = "round";
  return { g, width, height };
}

/** Colours of the present theme. */
export function theme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "faint", "line", "surface", "map"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

export const FONT = '13px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif';

/** A linear map between values [low, high] and pixels [begin, end]. */
export function scale([low, high], [begin, end]) {
  const to = (value) => begin + ((value - low) / (high - low)) * (end - begin);
  to.back = (pixel) => low + ((pixel - begin) / (end - begin)) * (high - low);
  return to;
}

export function polyline(g, points) {
  g.beginPath();
  points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
}

export function text(g, words, x, y, color, { align = "center", baseline = "middle", halo = null, font = FONT } = {}) {
  Object.assign(g, { font, textAlign: align, textBaseline: baseline });
  if (halo) {
    Object.assign(g, { strokeStyle: halo, lineWidth: 4 });
    g.strokeText(words, x, y);
  }
  g.fillStyle = color;
  g.fillText(words, x, y);
}

/** Ticks on the two axes of a plot: values with words, and a name for each axis. */
export function axes(g, { x, y, box, xTicks, yTicks, xName, yName }, colors) {
  g.lineWidth = 1;
  g.strokeStyle = colors.line;
  for (const [value] of xTicks) polyline(g, [[x(value), box.top], [x(value), box.bottom]]), g.stroke();
  for (const [value] of yTicks) polyline(g, [[box.left, y(value)], [box.right, y(value)]]), g.stroke();
  for (const [value, words] of xTicks) text(g, words, x(value), box.bottom + 12, colors.soft);
  for (const [value, words] of yTicks) text(g, words, box.left - 8, y(value), colors.soft, { align: "right" });
  if (xName) text(g, xName, box.right, box.bottom + 28, colors.soft, { align: "right" });
  if (yName) text(g, yName, box.left, box.top - 12, colors.soft, { align: "left" });
}

/** Round ticks of an interval, about `count` of them. */
export function ticks([low, high], count = 5) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10), found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9; k++) found.push([k * step, number(k * step, step)]);
  return found;
}

function number(value, step) {
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return value.toFixed(digits).replace("-", "−").replace(/^−0(\.0*)?$/, "0");
}

/** Multiples of π in an interval. */
export function turns([low, high], step = 1) {
  const found = [];
  for (let k = Math.ceil(low / Math.PI / step - 1e-9); k * step * Math.PI <= high + 1e-6; k++) {
    const count = k * step, whole = Number.isInteger(count) ? Math.abs(count) : Math.abs(count * 2);
    const words = count === 0 ? "0" : `${count < 0 ? "−" : ""}${whole === 1 ? "" : whole}π${Number.isInteger(count) ? "" : "/2"}`;
    found.push([count * Math.PI, words]);
  }
  return found;
}

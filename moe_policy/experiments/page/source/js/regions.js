// The gate's choice over two parameters: which expert where, and the lines between them.

import { largest } from "./network.js";

/** The gate's outputs on a grid of columns × rows nodes over the box {x: [low, high], y: [low, high]}. */
export function gridOf(logits, box, columns, rows) {
  const values = [], last = 1 - 1e-6;
  // The last node lies a little before the end of the box, where an angle would be written as that at its beginning.
  const at = ([low, high], i, count) => low + ((high - low) * Math.min(i, last * (count - 1))) / (count - 1);
  for (let j = 0; j < rows; j++)
    for (let i = 0; i < columns; i++) values.push(logits(at(box.x, i, columns), at(box.y, j, rows)));
  return { values, columns, rows, experts: values[0].length };
}

/** The expert at each of width × height pixels, between nodes by linear interpolation of the gate's outputs. */
export function choices({ values, columns, rows, experts }, width, height) {
  const found = new Uint8Array(width * height), chosen = values.map(largest);
  for (let v = 0; v < height; v++) {
    const y = (1 - (v + 0.5) / height) * (rows - 1), j = Math.min(Math.floor(y), rows - 2), t = y - j;
    for (let u = 0; u < width; u++) {
      const x = ((u + 0.5) / width) * (columns - 1), i = Math.min(Math.floor(x), columns - 2), s = x - i;
      const k = j * columns + i, choice = chosen[k];
      if (choice === chosen[k + 1] && choice === chosen[k + columns] && choice === chosen[k + columns + 1]) {
        found[v * width + u] = choice;
        continue;
      }
      const a = values[k], b = values[k + 1], c = values[k + columns], d = values[k + columns + 1];
      let best = 0, most = -Infinity;
      for (let e = 0; e < experts; e++) {
        const here = (1 - t) * ((1 - s) * a[e] + s * b[e]) + t * ((1 - s) * c[e] + s * d[e]);
        if (here > most) [best, most] = [e, here];
      }
      found[v * width + u] = best;
    }
  }
  return found;
}

/** Where the choice changes between two neighbouring nodes, as a fraction of the way; null where it does not. */
function crossing(one, other) {
  const i = largest(one), j = largest(other);
  if (i === j) return null;
  const before = one[i] - one[j], after = other[i] - other[j];
  return before / (before - after);
}

/** The lines between experts as polylines of [x, y] in fractions of the box. */
export function borders(grid) {
  const { values, columns, rows } = grid, links = new Map();
  const node = (i, j) => values[j * columns + i];
  const point = (i, j, along) => {
    const share = along ? crossing(node(i, j), node(i, j + 1)) : crossing(node(i, j), node(i + 1, j));
    if (share === null) return null;
    const x = (i + (along ? 0 : share)) / (columns - 1), y = (j + (along ? share : 0)) / (rows - 1);
    return { key: `${i},${j},${along}`, x, y };
  };
  const link = (one, other) => {
    for (const [from, to] of [[one, other], [other, one]]) {
      if (!links.has(from.key)) links.set(from.key, { point: from, next: [] });
      links.get(from.key).next.push(to.key);
    }
  };
  for (let j = 0; j < rows - 1; j++)
    for (let i = 0; i < columns - 1; i++) {
      const found = [point(i, j, 0), point(i + 1, j, 1), point(i, j + 1, 0), point(i, j, 1)].filter(Boolean);
      if (found.length === 2) link(found[0], found[1]);
      if (found.length > 2) {
        const mean = (name) => found.reduce((sum, each) => sum + each[name], 0) / found.length;
        const middle = { key: `${i},${j}`, x: mean("x"), y: mean("y") };
        for (const each of found) link(each, middle);
      }
    }
  return chains(links);
}

/** Polylines along all links, each once; they begin at ends and branches, then on closed lines. */
function chains(links) {
  const lines = [], used = new Set();
  const unused = (from) => links.get(from).next.find((to) => !used.has(`${from}>${to}`));
  const follow = (from) => {
    const line = [links.get(from).point];
    for (let to = unused(from); to !== undefined; to = links.get(from).next.length === 2 ? unused(from) : undefined) {
      used.add(`${from}>${to}`).add(`${to}>${from}`);
      line.push(links.get(to).point);
      from = to;
    }
    return line.map(({ x, y }) => [x, y]);
  };
  const keys = [...links.keys()], branches = keys.filter((key) => links.get(key).next.length !== 2);
  for (const key of [...branches, ...keys]) while (unused(key) !== undefined) lines.push(follow(key));
  return lines;
}

/** For each expert that is chosen somewhere, the pixel of its region that is farthest from other regions. */
export function labels(found, width, height) {
  const depth = new Uint16Array(found.length), best = new Map();
  const same = (k, other) => (found[k] === found[other] ? depth[other] : 0);
  for (let v = 0; v < height; v++)
    for (let u = 0; u < width; u++) {
      const k = v * width + u, edge = u === 0 || v === 0;
      depth[k] = edge ? 1 : 1 + Math.min(same(k, k - 1), same(k, k - width), same(k, k - width - 1));
      const most = best.get(found[k]);
      if (!most || depth[k] > most.depth) best.set(found[k], { depth: depth[k], u, v });
    }
  // The largest square that is one region; its middle.
  return [...best].map(([expert, { depth: d, u, v }]) => ({ expert, size: d, u: u - d / 2, v: v - d / 2 }));
}

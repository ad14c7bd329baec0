// A picture of space: parallel projection from a direction that the reader can turn.

export class Camera {
  constructor(azimuth, elevation) {
    Object.assign(this, { azimuth, elevation });
  }

  /** Turn by so many pixels of dragging. */
  turn(dx, dy) {
    this.azimuth -= dx / 150;
    this.elevation = Math.min(1.4, Math.max(-1.4, this.elevation + dy / 150));
  }

  /** A point as seen: to the right, upwards, and towards the reader. */
  seen([x, y, z]) {
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    const right = ca * y - sa * x, ahead = ca * x + sa * y;
    return [right, ce * z - se * ahead, ce * ahead + se * z];
  }

  /** A function from points to pixels [u, v, depth] that shows all `points` in a picture of a size. */
  fitted(points, width, height, margin) {
    const all = points.map((point) => this.seen(point)), range = (i) => [Math.min(...all.map((p) => p[i])), Math.max(...all.map((p) => p[i]))];
    const [[left, right], [low, high]] = [range(0), range(1)];
    const size = Math.min((width - 2 * margin) / (right - left), (height - 2 * margin) / (high - low));
    const to = (point) => {
      const [u, v, depth] = this.seen(point);
      return [width / 2 + (u - (left + right) / 2) * size, height / 2 - (v - (low + high) / 2) * size, depth];
    };
    return Object.assign(to, { size });
  }
}

/** The rotation from the axes of the body to those of the world, of roll φ, pitch θ and yaw ψ (Z-X-Y), as rows. */
export function attitude(phi, theta, psi) {
  const [sf, st, sp] = [phi, theta, psi].map(Math.sin), [cf, ct, cp] = [phi, theta, psi].map(Math.cos);
  return [
    [cp * ct - sp * sf * st, -sp * cf, cp * st + sp * sf * ct],
    [sp * ct + cp * sf * st, cp * cf, sp * st - cp * sf * ct],
    [-cf * st, sf, cf * ct],
  ];
}

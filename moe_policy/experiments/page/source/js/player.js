// The clock of the animation: it plays, pauses, repeats and can be set.

export class Player {
  /** `show` is called with the time in seconds whenever it changes. */
  constructor(button, slider, shown, show) {
    Object.assign(this, { button, slider, shown, show, time: 0, end: 1, playing: false, before: 0 });
    button.addEventListener("click", () => this.toggle());
    slider.addEventListener("input", () => {
      this.toggle(false);
      this.set(Number(slider.value));
    });
  }

  toggle(playing = !this.playing) {
    this.playing = playing;
    this.button.textContent = playing ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", String(playing));
    this.before = performance.now();
    if (playing) requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    if (!this.playing) return;
    const time = this.time + Math.max(0, now - this.before) / 1000;
    this.before = now;
    this.set(time > this.end ? 0 : time);
    requestAnimationFrame((next) => this.step(next));
  }

  set(time) {
    this.time = Math.min(time, this.end);
    this.slider.value = String(this.time);
    this.shown.textContent = `${this.time.toFixed(1)} s`;
    this.show(this.time);
  }

  /** The time at which the animation begins again. */
  until(end) {
    this.end = end;
    this.slider.max = String(end);
    this.time = Math.min(this.time, end);
  }
}

// Dragging with mouse, pen or finger, and moving with the arrow keys.

/** Call `move` with the pixel [x, y] of the canvas while the pointer drags, and with whether it is the first. */
export function draggable(canvas, move) {
  const pixel = (event) => {
    const { left, top } = canvas.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  };
  canvas.classList.add("draggable");
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    event.preventDefault();
    move(pixel(event), true);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) move(pixel(event), false);
  });
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Call `move` with the pixels to go for each press of an arrow key, ten times as many with Shift. */
export function movable(canvas, move) {
  canvas.addEventListener("keydown", (event) => {
    const arrow = ARROWS[event.key];
    if (!arrow) return;
    event.preventDefault();
    move(arrow.map((step) => step * (event.shiftKey ? 10 : 2)));
  });
}

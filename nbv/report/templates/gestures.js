// Gestures: mouse, touch and wheel on the canvas, as turns, shifts, zooms and picks.

const STILL = 5; // pixels that a click may wander

function watchPointers(canvas, camera, { changed, pick }) {
  const down = new Map();
  let wandered = 0;

  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("pointerdown", event => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    if (!down.size) wandered = 0;
    down.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", event => {
    const last = down.get(event.pointerId);
    if (!last) return;
    const step = [event.clientX - last[0], event.clientY - last[1]], height = canvas.clientHeight;
    const before = spread(down);
    down.set(event.pointerId, [event.clientX, event.clientY]);
    wandered += Math.hypot(...step);
    if (wandered <= STILL) return;
    if (down.size > 1) {
      const after = spread(down);
      if (before > 0 && after > 0) camera.zoom(before / after);
      camera.shift(-step[0] / height / down.size, step[1] / height / down.size);
    } else if (event.shiftKey || event.buttons & 6) {
      camera.shift(-step[0] / height, step[1] / height);
    } else {
      camera.turn(-3 * step[0] / height, 3 * step[1] / height);
    }
    changed();
  });
  const up = event => {
    const single = down.size === 1 && down.delete(event.pointerId);
    down.delete(event.pointerId);
    if (single && wandered <= STILL && event.type === "pointerup" && event.button === 0) {
      const box = canvas.getBoundingClientRect();
      pick(2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height);
    }
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", event => {
    if (document.activeElement !== canvas && !event.ctrlKey) return; // the page scrolls
    event.preventDefault();
    camera.zoom(Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * (event.deltaMode ? 0.05 : 0.0015)));
    changed();
  }, { passive: false });
}

// How far two fingers are apart.
function spread(down) {
  const [one, other] = [...down.values()];
  return other ? Math.hypot(one[0] - other[0], one[1] - other[1]) : 0;
}

const TURN = Math.PI / 24, SHIFT = 0.05;

// What a key does to the camera; whether it does anything.
function moveByKey(event, camera, aspect) {
  const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }, way = ways[event.key];
  if (event.ctrlKey || event.altKey || event.metaKey) return false;
  if (way && event.shiftKey) camera.shift(SHIFT * way[0], SHIFT * way[1]);
  else if (way) camera.turn(TURN * way[0], TURN * way[1]);
  else if (event.key === "+" || event.key === "=") camera.zoom(0.85);
  else if (event.key === "-") camera.zoom(1 / 0.85);
  else if (event.key === "Home") camera.home(aspect);
  else return false;
  return true;
}

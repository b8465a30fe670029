/* Pictures of one size with one zoom and one pan: what one shows, all show. */

import { svg } from "./elements.js";

const MOST = 40;
const STEP = 1.5;

/**
 * @param {number[]} size width and height of what is shown
 * @param {(x: number, y: number, target: Element) => void} onPick a click or a tap that was no drag
 * @param {(x: number, y: number) => void} [onPoint] where the pointer is
 */
export function linkedFrames(size, onPick, onPoint) {
  const [width, height] = size;
  const frames = [];
  const pointers = new Map();
  let [zoom, left, top] = [1, 0, 0];
  let travelled = 0;

  function apply() {
    left = Math.min(Math.max(left, 0), width - width / zoom);
    top = Math.min(Math.max(top, 0), height - height / zoom);
    frames.forEach((frame) => {
      frame.setAttribute("viewBox", [left, top, width / zoom, height / zoom].join(" "));
      frame.classList.toggle("zoomed", zoom > 1);
      unitOf(frame);
    });
  }

  /* Pixels of the picture in one pixel of the screen: what text is sized by. */
  function unitOf(frame) {
    const shown = frame.getBoundingClientRect().width || 400;
    frame.style.setProperty("--unit", String(width / zoom / shown));
  }

  function zoomAt(factor, x, y) {
    const next = Math.min(Math.max(zoom * factor, 1), MOST);
    left = x - (x - left) * zoom / next;
    top = y - (y - top) * zoom / next;
    zoom = next;
    apply();
  }

  /** @returns {[number, number]} */
  function placeIn(frame, event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(frame.getScreenCTM().inverse());
    return [at.x, at.y];
  }

  function drag(frame, event) {
    const before = pointers.get(event.pointerId);
    if (!before) { return; }
    const now = [event.clientX, event.clientY];
    travelled += Math.abs(now[0] - before[0]) + Math.abs(now[1] - before[1]);
    const others = Array.from(pointers.entries()).filter(([id]) => id !== event.pointerId);
    if (others.length) {
      const other = others[0][1];
      const far = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
      zoomAt(far(now) / Math.max(far(before), 1), ...placeIn(frame, event));
    } else if (zoom > 1) {
      const unit = width / zoom / frame.getBoundingClientRect().width;
      left -= (now[0] - before[0]) * unit;
      top -= (now[1] - before[1]) * unit;
      apply();
    }
    pointers.set(event.pointerId, now);
  }

  function listen(frame) {
    frame.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && zoom === 1) { return; }
      event.preventDefault();
      zoomAt(event.deltaY < 0 ? 1.2 : 1 / 1.2, ...placeIn(frame, event));
    }, { passive: false });
    frame.addEventListener("dblclick", (event) => zoomAt(2, ...placeIn(frame, event)));
    frame.addEventListener("pointerdown", (event) => {
      if (event.target.closest(".handle")) { return; }
      if (!pointers.size) { travelled = 0; }
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    frame.addEventListener("pointermove", (event) => {
      drag(frame, event);
      if (onPoint) { onPoint(...placeIn(frame, event)); }
    });
    frame.addEventListener("pointerup", (event) => {
      if (pointers.delete(event.pointerId) && travelled < 5 && !pointers.size) {
        onPick(...placeIn(frame, event), event.target);
      }
    });
    ["pointercancel", "pointerleave"].forEach((kind) =>
      frame.addEventListener(kind, (event) => pointers.delete(event.pointerId)));
  }

  return {
    /* A frame around children, in the picture's own coordinates. */
    frame(label, children) {
      const made = svg("svg", { class: "frame", tabindex: 0, role: "group", "aria-label": label,
        preserveAspectRatio: "xMidYMid meet" }, children);
      made.style.setProperty("aspect-ratio", width + " / " + height);
      frames.push(made);
      listen(made);
      apply();
      return made;
    },
    by(factor) { zoomAt(factor, left + width / zoom / 2, top + height / zoom / 2); },
    larger() { this.by(STEP); },
    smaller() { this.by(1 / STEP); },
    fit() { [zoom, left, top] = [1, 0, 0]; apply(); },
    move(dx, dy) { left += dx * width / zoom / 8; top += dy * height / zoom / 8; apply(); },
    /* A box in view, and not too small there. */
    show(box) {
      const outside = box[0] < left || box[1] < top || box[0] + box[2] > left + width / zoom ||
        box[1] + box[3] > top + height / zoom;
      if (!outside) { return; }
      zoom = Math.min(zoom, width / Math.max(box[2], 1), height / Math.max(box[3], 1), MOST);
      zoom = Math.max(zoom, 1);
      left = box[0] + box[2] / 2 - width / zoom / 2;
      top = box[1] + box[3] / 2 - height / zoom / 2;
      apply();
    },
    zoomed() { return zoom > 1; },
    resized() { frames.forEach(unitOf); },
  };
}

/* Keys of a frame that has the focus; true where one was meant for it. */
export function frameKey(frames, key) {
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  if (key === "+" || key === "=") { frames.larger(); return true; }
  if (key === "-") { frames.smaller(); return true; }
  if (key === "0") { frames.fit(); return true; }
  if (moves[key] && frames.zoomed()) { frames.move(...moves[key]); return true; }
  return false;
}

/* One thing, wherever it stands: its outline in every pane, its row, its advice, its body in 3D.
   Elements say in data-items which items they are about. */

/** @param {import("./outcomes.js").Item[]} items */
export function linkItems(root, items, onPicked) {
  const listeners = [];
  let [hot, pinned] = [new Set(), new Set()];

  /* With a prediction the ground truth it is about. */
  function withTruth(ids) {
    const all = new Set(ids);
    ids.forEach((id) => {
      const item = items[id];
      if (item && item.layer !== "truth" && item.t !== null && item.t !== undefined) { all.add(item.t); }
    });
    return all;
  }

  function draw() {
    const lit = hot.size ? hot : pinned;
    const all = withTruth([...lit]);
    root.querySelectorAll("[data-items]").forEach((node) => {
      const mine = idsOf(node);
      node.classList.toggle("hot", mine.some((id) => lit.has(id)));
      node.classList.toggle("about", mine.some((id) => all.has(id) && !lit.has(id)));
      node.classList.toggle("pinned", mine.some((id) => pinned.has(id)));
    });
    root.classList.toggle("lit", lit.size > 0);
    listeners.forEach((listener) => listener(lit));
    onPicked([...lit].map((id) => items[id]), pinned.size > 0);
  }

  function over(event) {
    const node = event.target.closest("[data-items]");
    const next = new Set(node ? idsOf(node) : []);
    if (next.size === hot.size && [...next].every((id) => hot.has(id))) { return; }
    hot = next;
    draw();
  }

  root.addEventListener("pointerover", (event) => { if (event.pointerType !== "touch") { over(event); } });
  root.addEventListener("pointerleave", () => { hot = new Set(); draw(); });
  root.addEventListener("focusin", over);
  root.addEventListener("focusout", () => { if (hot.size) { hot = new Set(); draw(); } });

  return {
    /* The same again lets go. */
    pin(ids) {
      const same = ids.length === pinned.size && ids.every((id) => pinned.has(id));
      pinned = new Set(same ? [] : ids);
      hot = new Set();
      draw();
      return pinned;
    },
    light(ids) { hot = new Set(ids); draw(); },
    release() {
      const had = pinned.size > 0;
      [hot, pinned] = [new Set(), new Set()];
      draw();
      return had;
    },
    listen(listener) { listeners.push(listener); },
    redraw: draw,
  };
}

export function idsOf(node) {
  return (node.dataset.items || "").split(" ").filter(Boolean).map(Number);
}

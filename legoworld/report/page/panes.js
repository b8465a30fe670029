/* The panes of a photo: what a side answered, the render of its scene, both under a slider, and
   how they differ. */

import { el, svg } from "./elements.js";
import { SIGNS, WORDS, describe, inDrawingOrder } from "./outcomes.js";
import { maskPath, shapePath } from "./shapes.js";
import { pictureUrl } from "./views.js";

/* A picture in a frame, stretched to the size the outlines are drawn for. */
export function picture(url, size, attributes) {
  if (!url) { return svg("rect", { class: "no-photo", width: size[0], height: size[1] }); }
  return svg("image", Object.assign({ href: url, width: size[0], height: size[1],
    preserveAspectRatio: "none" }, attributes));
}

/* Outlines of one side with the ground truth, and names beside those that are errors. */
export function outlines(items, side, size) {
  const mine = inDrawingOrder(items.filter((item) => item.side === side || item.layer === "truth"));
  const shapes = mine.map((item) => {
    const path = shapePath(item.shape, size);
    const ids = String(item.id);
    return svg("g", { class: "shape s-" + item.layer, "data-items": ids }, [
      item.shape.h ? svg("path", { class: "hatched", d: maskPath(item.shape.h, size[1]) }) : null,
      svg("path", { class: "halo", d: path }),
      svg("path", { class: "line", d: path }, [svg("title", {}, [describe(item)])]),
    ]);
  });
  return svg("g", { class: "outlines" }, [hatching(size), ...shapes, svg("g", { class: "tags" }, tags(mine, size)),
    svg("g", { class: "relation" })]);
}

/* Diagonal lines, for what is not visible of a shape. */
function hatching(size) {
  const step = Math.max(size[0] / 90, 2);
  return svg("pattern", { id: "hatch", width: step, height: step, patternUnits: "userSpaceOnUse",
    patternTransform: "rotate(45)" }, [svg("rect", { class: "hatch-line", width: step / 4, height: step })]);
}

/* Names that do not cover each other: what is missed first, then what is false. */
function tags(items, size) {
  const order = ["fn", "fp", "tp", "object", "other"];
  const taken = [];
  const unit = size[0] / 480;
  const ranked = new Set(items.filter((item) => item.score !== undefined).map((item) => item.score)).size > 1;
  return items.filter((item) => item.layer !== "truth").sort((a, b) =>
    order.indexOf(a.layer) - order.indexOf(b.layer) || b.shape.box[2] - a.shape.box[2],
  ).map((item) => {
    const sure = ranked && item.score !== undefined ? " " + item.score.toFixed(2) : "";
    const text = SIGNS[item.layer] + item.name + sure + (item.iou === null ? "" : " (IoU " + item.iou.toFixed(2) + ")");
    const wide = text.length * 6.3 * unit;
    const x = Math.max(0, Math.min(item.shape.box[0], size[0] - wide));
    const y = Math.max(item.shape.box[1], 0);
    const covers = taken.some((t) => Math.abs(t[1] - y) < 13 * unit && t[0] < x + wide && x < t[0] + t[2]);
    if (!covers) { taken.push([x, y, wide]); }
    return svg("text", { class: "tag s-" + item.layer + (covers ? " covered" : ""), x, y,
      dx: "0.25em", dy: "1.05em", "data-items": item.id }, [text]);
  });
}

function missing(size, text) {
  return svg("text", { class: "no-photo-text", x: size[0] / 2, y: size[1] / 2 }, [text]);
}

/* What can be shown: [key, title, why it is not there or "", make]. */
export function paneChoices(view, items, frames) {
  const size = view.size_wh;
  const photo = pictureUrl("photo", view.photo);
  const many = view.sides.length > 1;
  const choices = view.sides.map((side, k) => ({ key: "side" + k, title: many ? side.label : "photo",
    why: "", make: () => frames.frame(side.label + ": outlines over the photo", [picture(photo, size),
      photo ? null : missing(size, "no photo"), outlines(items, k, size)]) }));
  view.sides.forEach((side, k) => {
    if (!side.scene) { return; }
    const render = pictureUrl("render", side.scene.render);
    const of = many && view.sides.filter((s) => s.scene).length > 1 ? " of " + side.label : "";
    const both = render && photo ? "" : side.scene.render_said || "there is no photo";
    choices.push({ key: "render" + k, title: "render" + of, why: render ? "" : side.scene.render_said,
      make: () => frames.frame("render of the scene" + of, [picture(render, size),
        outlines(items, k, size)]) });
    choices.push({ key: "slide" + k, title: "photo | render" + of, why: both,
      make: () => slider(photo, render, size, frames) });
    choices.push({ key: "differ" + k, title: "difference" + of, why: both,
      make: () => frames.frame("difference of photo and render" + of, [
        svg("g", { class: "differ" }, [picture(photo, size), picture(render, size, { class: "over" })])]) });
  });
  return choices;
}

/* Photo on the left of a line, render on the right; the line is dragged, or moved by keys. */
function slider(photo, render, size, frames) {
  const id = "slide-" + Math.random().toString(36).slice(2);
  const clip = svg("rect", { x: size[0] / 2, y: 0, width: size[0], height: size[1] });
  const line = svg("line", { class: "divider", y1: 0, y2: size[1] });
  const frame = frames.frame("photo on the left, render on the right", [
    picture(photo, size),
    svg("clipPath", { id }, [clip]),
    svg("g", { "clip-path": "url(#" + id + ")" }, [picture(render, size)]), line]);
  const range = el("input", { type: "range", min: 0, max: 100, value: 50, class: "slide",
    "aria-label": "share of the photo, left of the line" });
  function set() {
    const x = size[0] * Number(range.value) / 100;
    clip.setAttribute("x", String(x));
    line.setAttribute("x1", String(x));
    line.setAttribute("x2", String(x));
  }
  range.addEventListener("input", set);
  set();
  return el("div", { class: "sliding" }, [frame, range]);
}

/* Which outlines are drawn: a switch for each sort, with a sample of its line. */
export function layerSwitches(items, shown, layers, toggle) {
  const sorts = layers.filter((layer) =>
    layer !== "other" || items.some((item) => item.layer === layer));
  const boxes = sorts.map((layer) => switchOf(layer, WORDS[layer], layer, shown, toggle));
  boxes.push(switchOf("names", "names", null, shown, toggle));
  return el("div", { class: "layers", role: "group", "aria-label": "outlines" }, boxes);
}

function switchOf(key, text, layer, shown, toggle) {
  const input = el("input", { type: "checkbox", "data-layer": key });
  input.checked = shown.has(key);
  input.addEventListener("change", () => toggle(key, input.checked));
  return el("label", {}, [input, layer ? el("span", { class: "key k-" + layer }) : null, " " + text]);
}

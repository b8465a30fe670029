/* Panes of one array for each image: ground truth, predictions and errors, one cursor for all. */

import { el, svg } from "./elements.js";
import { paneChoices, picture } from "./panes.js";
import { pictureUrl } from "./views.js";

const NONE = [140, 140, 140];

export function colorAt(map, share) {
  const at = Math.min(Math.max(share, 0), 1) * (map.length - 1);
  const low = Math.min(Math.floor(at), map.length - 2);
  return map[low].map(function (v, c) { return v + (map[low + 1][c] - v) * (at - low); });
}

/* The picture of n pixels of which color(i) tells each, null where there is none. */
export function paintedPixels(n, size, color) {
  const canvas = el("canvas", { width: size[0], height: size[1] });
  const context = canvas.getContext("2d");
  const picture = context.createImageData(size[0], size[1]);
  for (let i = 0; i < n; i += 1) {
    const rgb = color(i) || NONE;
    picture.data.set([rgb[0], rgb[1], rgb[2], 255], 4 * i);
  }
  context.putImageData(picture, 0, 0);
  return canvas.toDataURL();
}

/* A bar whose colour at a share is color(value(share)), with the values written below. */
export function legend(title, value, color, text) {
  const canvas = el("canvas", { width: 256, height: 1 });
  const context = canvas.getContext("2d");
  for (let i = 0; i < 256; i += 1) {
    context.fillStyle = "rgb(" + color(value(i / 255)).map(Math.round).join(",") + ")";
    context.fillRect(i, 0, 1, 1);
  }
  const marks = [0, 0.25, 0.5, 0.75, 1].map(function (share) { return el("span", {}, [text(value(share))]); });
  return el("div", { class: "legend" }, [title, canvas, el("div", { class: "ticks" }, marks)]);
}

/* What the colour of no value means, and which pixel of the photo a pixel is. */
export function noneLegend(what, measured) {
  return el("p", { class: "sub" }, [el("span", { class: "swatch" }), " " + what + ". A pixel of these" +
    " panes is one pixel of the photo, one with " + measured + " where its block has any; the" +
    " prediction is read at the same pixel."]);
}

/* Choices of panes, legends, and what happens when the pointer is at x, y of the photo. drawn: the
   arrays' sizes; panes: [key, title, url] of each; said: a pixel's values, by its place. */
export function pixelPanes(view, frames, readout, drawn, panes, said, legends) {
  const [wide, high] = drawn.size_wh;
  const crosses = [];
  const photo = ["photo", "photo", pictureUrl("photo", view.photo)];
  /** @type {any[]} */
  const choices = [photo, ...panes].map(([key, title, url]) => ({ key, title,
    why: url ? "" : "there is no photo", usual: undefined, make: () => {
      const cross = svg("g", { class: "cross", visibility: "hidden" }, [svg("circle", { class: "ring" }),
        svg("circle", { class: "dot" })]);
      crosses.push(cross);
      return frames.frame(title, [picture(url, view.size_wh, { class: key === "photo" ? null : "pixels" }), cross]);
    } }));
  paneChoices(view, [], frames).filter((c) => !c.key.startsWith("side")).forEach((c) => {
    c.usual = false;
    choices.push(c);
  });
  function point(x, y) {
    const column = Math.min(Math.max(Math.floor(x / view.size_wh[0] * wide), 0), wide - 1);
    const row = Math.min(Math.max(Math.floor(y / view.size_wh[1] * high), 0), high - 1);
    readout.textContent = "near x " + Math.floor((column + 0.5) * drawn.image_wh[0] / wide) + ", y " +
      Math.floor((row + 0.5) * drawn.image_wh[1] / high) + ": " + said(row * wide + column);
    crosses.forEach((cross) => {
      cross.setAttribute("visibility", "visible");
      cross.setAttribute("transform", "translate(" + (column + 0.5) * view.size_wh[0] / wide + " " +
        (row + 0.5) * view.size_wh[1] / high + ")");
    });
  }
  return { choices, point, legends: el("div", {}, legends) };
}

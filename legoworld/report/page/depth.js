/* Depth panes: ground truth and predictions on one scale, signed errors on another, one cursor for
   all. */

import { el, svg } from "./elements.js";
import { paneChoices, picture } from "./panes.js";
import { pictureUrl } from "./views.js";

/* Viridis (Smith and van der Walt, matplotlib) and ColorBrewer's PuOr: both safe for colour-blind
   eyes. Near is bright; a prediction that is too near is orange, one that is too far purple. */
const NEAR_TO_FAR = [[253, 231, 37], [159, 218, 58], [74, 193, 109], [31, 161, 135], [39, 127, 142],
  [54, 92, 141], [70, 50, 127], [68, 1, 84]];
const NEAR_FAR_ERROR = [[179, 88, 6], [224, 130, 20], [253, 184, 99], [254, 224, 182], [247, 247, 247],
  [216, 218, 235], [178, 171, 210], [128, 115, 172], [84, 39, 136]];
const NONE = [140, 140, 140];

function colorAt(map, share) {
  const at = Math.min(Math.max(share, 0), 1) * (map.length - 1);
  const low = Math.min(Math.floor(at), map.length - 2);
  return map[low].map(function (v, c) { return v + (map[low + 1][c] - v) * (at - low); });
}

/* Float64Array of metres, NaN where there is none. */
export function depths(codes, depth) {
  const bytes = atob(codes);
  const z = new Float64Array(bytes.length / 2);
  for (let i = 0; i < z.length; i += 1) {
    const code = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
    z[i] = code === 65535 ? NaN : depth.z0_m * Math.exp(depth.step * code);
  }
  return z;
}

function paintedPixels(values, size, color) {
  const canvas = el("canvas", { width: size[0], height: size[1] });
  const context = canvas.getContext("2d");
  const picture = context.createImageData(size[0], size[1]);
  for (let i = 0; i < values.length; i += 1) {
    const rgb = Number.isNaN(values[i]) ? NONE : color(values[i]);
    picture.data.set([rgb[0], rgb[1], rgb[2], 255], 4 * i);
  }
  context.putImageData(picture, 0, 0);
  return canvas.toDataURL();
}

function depthColor(depth) {
  const near = 1 / depth.near_far_z_m[0];
  const far = 1 / depth.near_far_z_m[1];
  return function (z) { return colorAt(NEAR_TO_FAR, (near - 1 / z) / Math.max(near - far, 1e-12)); };
}

function errorColor(depth) {
  const end = Math.max(depth.error_m, 1e-9);
  return function (error) { return colorAt(NEAR_FAR_ERROR, (error / end + 1) / 2); };
}

/* A bar whose colour at a share is color(value(share)), with the values written below. */
function legend(title, value, color, ticks) {
  const canvas = el("canvas", { width: 256, height: 1 });
  const context = canvas.getContext("2d");
  for (let i = 0; i < 256; i += 1) {
    context.fillStyle = "rgb(" + color(value(i / 255)).map(Math.round).join(",") + ")";
    context.fillRect(i, 0, 1, 1);
  }
  const marks = ticks.map(function (share) { return el("span", {}, [metres(value(share))]); });
  return el("div", { class: "legend" }, [title, canvas, el("div", { class: "ticks" }, marks)]);
}

function metres(z) {
  if (Number.isNaN(z)) { return "none"; }
  return (Math.abs(z) < 10 ? z.toFixed(3) : z.toFixed(2)) + " m";
}

function signed(z) { return (z > 0 ? "+" : "") + metres(z); }

/* Choices of panes, legends, and what happens when the pointer is at x, y of the photo. */
export function depthPanes(view, frames, readout) {
  const depth = view.depth;
  const [wide, high] = depth.size_wh;
  const truth = depths(depth.truth, depth);
  const sides = [];
  const crosses = [];
  const choices = [];
  function add(key, title, url, pixelated, usual) {
    choices.push({ key, title, why: url ? "" : "there is no photo", usual, make: () => {
      const cross = svg("g", { class: "cross", visibility: "hidden" }, [svg("circle", { class: "ring" }),
        svg("circle", { class: "dot" })]);
      crosses.push(cross);
      return frames.frame(title, [picture(url, view.size_wh, { class: pixelated ? "pixels" : null }), cross]);
    } });
  }
  add("photo", "photo", pictureUrl("photo", view.photo), false);
  add("truth", "ground truth", paintedPixels(truth, depth.size_wh, depthColor(depth)), true);
  view.sides.forEach((side, k) => {
    if (depth.aligned[k] === null) { return; }
    const aligned = depths(depth.aligned[k], depth);
    const error = aligned.map((z, i) => z - truth[i]);
    sides.push({ label: side.label, aligned, error });
    add("aligned" + k, side.label + ", aligned", paintedPixels(aligned, depth.size_wh, depthColor(depth)), true);
    add("error" + k, side.label + " minus ground truth", paintedPixels(error, depth.size_wh, errorColor(depth)), true);
  });
  paneChoices(view, [], frames).filter((c) => !c.key.startsWith("side")).forEach((c) => {
    c.usual = false;
    choices.push(c);
  });
  function point(x, y) {
    const column = Math.min(Math.max(Math.floor(x / view.size_wh[0] * wide), 0), wide - 1);
    const row = Math.min(Math.max(Math.floor(y / view.size_wh[1] * high), 0), high - 1);
    const at = row * wide + column;
    readout.textContent = "near x " + Math.floor((column + 0.5) * depth.image_wh[0] / wide) + ", y " +
      Math.floor((row + 0.5) * depth.image_wh[1] / high) + ": ground truth " + metres(truth[at]) +
      sides.map((s) => {
        const off = s.error[at];
        const share = Number.isNaN(off) ? "" : ", off " + signed(off) + " (" +
          (100 * off / truth[at]).toFixed(1) + " %)";
        return "; " + s.label + " " + metres(s.aligned[at]) + share;
      }).join("");
    crosses.forEach((cross) => {
      cross.setAttribute("visibility", "visible");
      cross.setAttribute("transform", "translate(" + (column + 0.5) * view.size_wh[0] / wide + " " +
        (row + 0.5) * view.size_wh[1] / high + ")");
    });
  }
  return { choices, point, legends: el("div", {}, legends(depth)) };
}

function legends(depth) {
  const near = 1 / depth.near_far_z_m[0];
  const far = 1 / depth.near_far_z_m[1];
  const z = (share) => 1 / (near - share * (near - far));
  const error = (share) => (2 * share - 1) * depth.error_m;
  const none = el("p", { class: "sub" }, [el("span", { class: "swatch" }), " no depth. A pixel of these" +
    " panes is one pixel of the photo, one with measured depth where its block has any; the" +
    " prediction is read at the same pixel."]);
  const ticks = [0, 0.25, 0.5, 0.75, 1];
  return [
    legend("depth, aligned: near to far, even in 1/z", z, depthColor(depth), ticks),
    legend("aligned minus ground truth: too near to too far", error, errorColor(depth), ticks),
    none,
  ];
}

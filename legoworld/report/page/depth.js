/* Depth panes: ground truth and predictions on one scale, signed errors on another. */

import { colorAt, legend, noneLegend, paintedPixels, pixelPanes } from "./pixel_panes.js";
import { bytesOf } from "./views.js";

/* Viridis (Smith and van der Walt, matplotlib) and ColorBrewer's PuOr: both safe for colour-blind
   eyes. Near is bright; a prediction that is too near is orange, one that is too far purple. */
export const NEAR_TO_FAR = [[253, 231, 37], [159, 218, 58], [74, 193, 109], [31, 161, 135], [39, 127, 142],
  [54, 92, 141], [70, 50, 127], [68, 1, 84]];
const NEAR_FAR_ERROR = [[179, 88, 6], [224, 130, 20], [253, 184, 99], [254, 224, 182], [247, 247, 247],
  [216, 218, 235], [178, 171, 210], [128, 115, 172], [84, 39, 136]];

/* Float64Array of metres, NaN where there is none. */
export function depths(codes, depth) {
  return new Float64Array(new Uint16Array(bytesOf(codes).buffer)).map((code) =>
    code === 65535 ? NaN : depth.z0_m * Math.exp(depth.step * code));
}

function depthColor(depth) {
  const near = 1 / depth.near_far_z_m[0];
  const far = 1 / depth.near_far_z_m[1];
  return function (z) { return colorAt(NEAR_TO_FAR, (near - 1 / z) / Math.max(near - far, 1e-12)); };
}

function depthErrorColor(depth) {
  const end = Math.max(depth.error_m, 1e-9);
  return function (error) { return colorAt(NEAR_FAR_ERROR, (error / end + 1) / 2); };
}

function metres(z) {
  if (Number.isNaN(z)) { return "none"; }
  return (Math.abs(z) < 10 ? z.toFixed(3) : z.toFixed(2)) + " m";
}

function signed(z) { return (z > 0 ? "+" : "") + metres(z); }

function depthPicture(depth, values, color) {
  return paintedPixels(values.length, depth.size_wh, (i) => Number.isNaN(values[i]) ? null : color(values[i]));
}

/* Aligned minus ground truth in metres, and beside it what each pixel's AbsRel is; null without a score. */
export function depthErrors(depth, k) {
  if (!depth || depth.aligned[k] === null) { return null; }
  const [truth, aligned] = [depths(depth.truth, depth), depths(depth.aligned[k], depth)];
  const error = aligned.map((z, i) => z - truth[i]);
  return { aligned, error, relative: error.map((e, i) => Math.abs(e) / truth[i]) };
}

/* The signed error of the first side as a picture. */
export function depthErrorUrl(depth) {
  const made = depthErrors(depth, 0);
  return made && depthPicture(depth, made.error, depthErrorColor(depth));
}

export function depthPanes(view, frames, readout) {
  const depth = view.depth;
  const truth = depths(depth.truth, depth);
  const sides = [];
  const panes = [["truth", "ground truth", depthPicture(depth, truth, depthColor(depth))]];
  view.sides.forEach((side, k) => {
    const made = depthErrors(depth, k);
    if (!made) { return; }
    const { aligned, error } = made;
    sides.push({ label: side.label, aligned, error });
    panes.push(["aligned" + k, side.label + ", aligned", depthPicture(depth, aligned, depthColor(depth))],
      ["error" + k, side.label + " minus ground truth", depthPicture(depth, error, depthErrorColor(depth))]);
  });
  const said = (at) => "ground truth " + metres(truth[at]) + sides.map((s) => {
    const off = s.error[at];
    const share = Number.isNaN(off) ? "" : ", off " + signed(off) + " (" + (100 * off / truth[at]).toFixed(1) + " %)";
    return "; " + s.label + " " + metres(s.aligned[at]) + share;
  }).join("");
  return pixelPanes(view, frames, readout, depth, panes, said, depthLegends(depth));
}

function depthLegends(depth) {
  const near = 1 / depth.near_far_z_m[0];
  const far = 1 / depth.near_far_z_m[1];
  const z = (share) => 1 / (near - share * (near - far));
  const error = (share) => (2 * share - 1) * depth.error_m;
  return [
    legend("depth, aligned: near to far, even in 1/z", z, depthColor(depth), metres),
    legend("aligned minus ground truth: too near to too far", error, depthErrorColor(depth), metres),
    noneLegend("no depth", "measured depth"),
  ];
}

/* Normals panes: vectors as colours, and the angle between prediction and ground truth. */

import { NEAR_TO_FAR } from "./depth.js";
import { el } from "./elements.js";
import { colorAt, legend, noneLegend, paintedPixels, pixelPanes } from "./pixel_panes.js";
import { bytesOf } from "./views.js";

/* x, y, z of each pixel as signed bytes; 0, 0, 0 where there is none. */
function vectors(codes) { return new Int8Array(bytesOf(codes).buffer); }

/* Float64Array of degrees, NaN where there is none. */
function angles(codes) {
  return new Float64Array(new Uint16Array(bytesOf(codes).buffer)).map((code) => code === 65535 ? NaN : code / 100);
}

/* Right is red, up is green, towards the camera is blue: a frontal wall is light blue. */
function vectorColor(x, y, z) { return [128 + x, 128 - y, 128 - z]; }

function angleColor(normals) {
  const end = Math.max(normals.error_deg, 1e-9);
  return (error) => colorAt(NEAR_TO_FAR, 1 - error / end);
}

function degrees(error) { return Number.isNaN(error) ? "none" : error.toFixed(error < 10 ? 2 : 1) + "\u00b0"; }

function triple(xyz, at) {
  const [x, y, z] = xyz.slice(3 * at, 3 * at + 3);
  return x || y || z ? "(" + [x, y, z].map((v) => (v / 127).toFixed(2)).join(", ") + ")" : "none";
}

export function normalsPanes(view, frames, readout) {
  const normals = view.normals;
  const [wide, high] = normals.size_wh;
  const color = (xyz) => (i) => {
    const [x, y, z] = xyz.slice(3 * i, 3 * i + 3);
    return x || y || z ? vectorColor(x, y, z) : null;
  };
  const truth = vectors(normals.truth);
  const sides = [];
  const panes = [["truth", "ground truth", paintedPixels(wide * high, normals.size_wh, color(truth))]];
  view.sides.forEach((side, k) => {
    if (normals.predicted[k] === null) { return; }
    const predicted = vectors(normals.predicted[k]);
    const error = angles(normals.errors[k]);
    sides.push({ label: side.label, predicted, error });
    panes.push(["normals" + k, side.label, paintedPixels(wide * high, normals.size_wh, color(predicted))],
      ["error" + k, side.label + ", angle to ground truth", paintedPixels(wide * high, normals.size_wh,
        (i) => Number.isNaN(error[i]) ? null : angleColor(normals)(error[i]))]);
  });
  const said = (at) => "ground truth " + triple(truth, at) + sides.map((s) =>
    "; " + s.label + " " + triple(s.predicted, at) + ", off " + degrees(s.error[at])).join("");
  return pixelPanes(view, frames, readout, normals, panes, said, normalsLegends(normals));
}

function normalsLegends(normals) {
  return [
    el("div", { class: "legend" }, ["normals as on a ball: right is red, up is green, towards the camera is blue ",
      el("img", { src: colorBall(64), width: 64, height: 64, alt: "a ball in these colours" })]),
    legend("angle to the ground truth", (share) => share * normals.error_deg, angleColor(normals), degrees),
    noneLegend("no normal", "a measured normal"),
  ];
}

function colorBall(side) {
  return paintedPixels(side * side, [side, side], (i) => {
    const x = (i % side + 0.5) / side * 2 - 1;
    const y = (Math.floor(i / side) + 0.5) / side * 2 - 1;
    const z2 = 1 - x * x - y * y;
    return z2 < 0 ? null : vectorColor(127 * x, 127 * y, -127 * Math.sqrt(z2));
  });
}

/* Curves, bars and histograms of a section. */

import { casesPlot } from "./cases_plot.js";
import { chart, fileButtons, pathOf, plotFigure, roundTicks } from "./chart.js";
import { el, fixed, svg } from "./elements.js";
import { sectionElement } from "./views.js";

const MOST_CATEGORIES = 24;
const TENTHS = [0, 0.2, 0.4, 0.6, 0.8, 1];
const DRAWN_PLOTS = new Set();

/** @param {PageSection} section */
export function plots(section) {
  const host = sectionElement(section.key).querySelector("[data-plots]");
  if (!host || DRAWN_PLOTS.has(section.key)) { return; }
  DRAWN_PLOTS.add(section.key);
  sectionElement(section.key).querySelectorAll("figure.ties svg").forEach(tieFiles);
  const found = section.plots;
  host.append(...found.precision_recall.length ? [precisionRecall(section)] : [],
    ...section.errors.length ? [errorKinds(section)] : [],
    ...found.iou.length ? [iouHistogram(section)] : [],
    ...section.categories.length ? [categoryBars(section)] : [],
    ...found.depth_error.length ? [depthError(section)] : [],
    ...section.bench ? [casesPlot(section)] : []);
  if (!host.childElementCount) { host.append(el("p", { class: "sub" }, ["No plots: the evaluations are not here."])); }
}

/* The drawing of tie orders is in the page; its bars say what they count. */
function tieFiles(drawing) {
  const figure = drawing.closest("figure");
  const name = "tie-orders-" + figure.dataset.name.replace(/[^\w-]+/g, "-");
  const rows = Array.from(drawing.querySelectorAll(".bar title"), (t) => t.textContent.match(/^([\d,]+) .*?([\d.]+) \S+ ([\d.]+)$/))
    .filter(Boolean).map((m) => [m[2], m[3], m[1].replaceAll(",", "")]);
  figure.append(fileButtons({ name, title: figure.dataset.name + ", tie orders", note: "", rows: [["AP from", "to", "orders"], ...rows], root: drawing }));
}

/* A side keeps its mark through every plot. */
function placeOf(section, label) { return Math.min(section.sides.findIndex((s) => s.label === label), 2); }

function precisionRecall(section) {
  const curves = section.plots.precision_recall;
  const made = chart({ label: "precision against recall at IoU 0.5", x: unit("recall"), y: unit("precision") });
  const at = (values) => values.map((v, i) => [made.sx(i / 100), made.sy(v)]);
  const keys = [];
  curves.forEach((curve) => {
    const k = placeOf(section, curve.label);
    const equal = curve.policy === "equal confidence" && section.sides.length > 0 && curves.some((c) =>
      c.label === curve.label && c.policy === "own scores") ? " equal" : "";
    if (curve.draws) {
      made.marks.append(svg("path", { class: "band p" + k, d: pathOf([...at(curve.low), ...at(curve.high).reverse()]) + "Z" }));
    }
    made.marks.append(svg("path", { class: "curve p" + k + equal, d: pathOf(at(curve.precision)) }, [
      svg("title", {}, [curve.label + ", " + curve.policy])]));
    keys.push(["p" + k + equal, curve.label + ", " + curve.policy]);
  });
  const rows = curves.flatMap((c) => c.precision.map((p, i) => [c.label, c.policy, (i / 100).toFixed(2), p,
    c.low.length ? c.low[i] : "", c.high.length ? c.high[i] : ""]));
  return plotFigure({ name: "precision-recall-" + section.key, title: "Precision and recall at IoU 0.5",
    root: made.root, keys, head: ["side", "policy", "recall", "precision", "low", "high"], rows,
    note: "The mean over " + curves[0].categories + " categories with ground truth; the area under a curve is AP50. " +
      (curves.some((c) => c.draws) ? "Bands: 95 % of " + curves.find((c) => c.draws).draws +
        " random orders of equally confident predictions." : "") });
}

function unit(title) { return { from: 0, to: 1, ticks: TENTHS, title }; }

function errorKinds(section) {
  const kinds = Object.keys(section.errors[0].counts);
  const totals = section.errors.map((e) => kinds.reduce((n, k) => n + e.counts[k], 0));
  const most = Math.max(1, ...totals);
  const width = 520;
  const root = svg("svg", { class: "chart", viewBox: "0 0 " + width + " " + (section.errors.length * 46 + 12),
    role: "img", "aria-label": "errors by kind" });
  section.errors.forEach((e, row) => {
    let x = 0;
    const y = row * 46;
    root.append(svg("text", { class: "name", x: 0, y: y + 13 }, [e.label + ": " + totals[row] + " errors"]));
    kinds.forEach((kind) => {
      const wide = e.counts[kind] / most * width;
      if (!wide) { return; }
      root.append(svg("rect", { class: "kind kind-" + kind, x, y: y + 18, width: wide, height: 22 }, [
        svg("title", {}, [kind + ": " + e.counts[kind]])]));
      if (wide > 26) { root.append(svg("text", { class: "on-bar on-" + kind, x: x + wide / 2, y: y + 33, "text-anchor": "middle" }, [e.counts[kind]])); }
      x += wide;
    });
  });
  const rows = section.errors.flatMap((e) => kinds.map((kind) => [e.label, kind, e.counts[kind], e.images[kind]]));
  return plotFigure({ name: "errors-" + section.key, title: "Error kinds", root,
    keys: kinds.map((kind) => ["kind-" + kind, kind]), head: ["side", "kind", "errors", "images"], rows,
    note: "False positives by their first kind that fits, and missed objects that no false positive is about." });
}

function iouHistogram(section) {
  const hists = section.plots.iou;
  const most = Math.max(1, ...hists.flatMap((h) => h.tp.map((n, i) => n + h.low[i])));
  const ticks = roundTicks(most, 4);
  const made = chart({ label: "IoU of predictions with their object", x: { from: 0.1, to: 1,
    ticks: [0.1, 0.25, 0.5, 0.75, 1], title: "IoU with the object of its category" },
  y: { from: 0, to: ticks[ticks.length - 1], ticks, title: "predictions" } });
  const n = hists.length;
  hists.forEach((h, k) => h.tp.forEach((tp, i) => {
    const wide = (made.sx(h.edges[i + 1]) - made.sx(h.edges[i]) - 2) / n;
    const x = made.sx(h.edges[i]) + 1 + k * wide;
    [["low", h.low[i], 0], ["tp", tp, h.low[i]]].forEach(([sort, count, below]) => {
      if (!count) { return; }
      const top = made.sy(Number(below) + Number(count));
      made.marks.append(svg("rect", { class: "iou iou-" + sort + " h" + Math.min(k, 2), x, y: top, width: Math.max(wide - 1, 1),
        height: made.sy(Number(below)) - top }, [svg("title", {}, [h.label + ", IoU " + h.edges[i] + " to " + h.edges[i + 1] + ": " + count])]));
    });
  }));
  const rows = hists.flatMap((h) => h.tp.map((tp, i) => [h.label, h.edges[i], h.edges[i + 1], tp, h.low[i]]));
  const keys = hists.flatMap((h, k) => [["iou-tp h" + Math.min(k, 2), h.label + ", true positives"],
    ["iou-low h" + Math.min(k, 2), h.label + ", localisation errors"]]);
  return plotFigure({ name: "iou-" + section.key, title: "How well predictions fit", root: made.root, keys,
    head: ["side", "IoU from", "to", "true positives", "localisation errors"], rows,
    note: "AP averages over IoU 0.50 to 0.95: a true positive at 0.6 counts at three of ten thresholds." });
}

function categoryBars(section) {
  const all = section.categories.filter((c) => c.n_truth).sort((a, b) => b.n_truth - a.n_truth || a.id - b.id);
  const shown = all.slice(0, MOST_CATEGORIES);
  const n = section.sides.length;
  const high = 11 * n + 7;
  const width = 520;
  const [left, right] = [190, width - 40];
  const root = svg("svg", { class: "chart", viewBox: "0 0 " + width + " " + (shown.length * high + 26), role: "img",
    "aria-label": "AP by category" }, TENTHS.flatMap((v) => {
    const x = left + v * (right - left);
    return [svg("line", { class: "grid", x1: x, x2: x, y1: 0, y2: shown.length * high }),
      svg("text", { class: "tick", x, y: shown.length * high + 16, "text-anchor": "middle" }, [v])];
  }));
  shown.forEach((c, i) => {
    const y = i * high;
    root.append(svg("text", { class: "name", x: left - 8, y: y + high / 2 + 4, "text-anchor": "end" }, [
      cut(c.name) + " (" + c.n_truth + ")"]));
    c.cells.forEach((cell, k) => {
      const ap = cell ? cell.ap : 0;
      const wide = (ap || 0) * (right - left);
      const top = y + 3 + k * 11;
      root.append(svg("rect", { class: "bar h" + Math.min(k, 2), x: left, y: top, width: Math.max(wide, 0.5), height: 10 }, [
        svg("title", {}, [c.name + ", " + section.sides[k].label + ": AP " + fixed(ap)])]),
      svg("text", { class: "tick", x: left + wide + 4, y: top + 9 }, [fixed(ap, 2)]));
    });
  });
  const rows = all.flatMap((c) => c.cells.map((cell, k) => [c.name, section.sides[k].label, c.n_truth,
    cell ? fixed(cell.ap, 4) : "-", cell ? cell.n : 0, cell ? cell.tp : 0, cell ? cell.fp : 0]));
  return plotFigure({ name: "categories-" + section.key, title: "AP by category", root,
    keys: section.sides.map((s, k) => ["bar h" + Math.min(k, 2), s.label]),
    head: ["category", "side", "objects", "AP", "predictions", "TP", "FP"], rows,
    note: (all.length > shown.length ? "The " + shown.length + " categories with most objects of " + all.length +
      "; the table has all. " : "") + "In brackets: annotated objects." });
}

function cut(name) { return name.length > 20 ? name.slice(0, 19) + "\u2026" : name; }

function depthError(section) {
  const found = section.plots.depth_error;
  const edges = found.flatMap((d) => d.edges_m);
  const [from, to] = [Math.min(...edges), Math.max(...edges)];
  const most = Math.max(0.05, ...found.flatMap((d) => d.high.filter((v) => v !== null)));
  const ticks = roundTicks(Math.min(most, 2), 4);
  const top = ticks[ticks.length - 1];
  const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500].filter((v) => v >= from && v <= to);
  const made = chart({ label: "depth error against depth", x: { from, to, ticks: steps.length > 1 ? steps : [from, to],
    title: "depth of the ground truth, m", log: true, text: (v) => String(Number(v.toPrecision(3))) },
  y: { from: 0, to: top, ticks, title: "error / depth" } });
  found.forEach((d, k) => {
    const middle = d.n.map((_, i) => Math.sqrt(d.edges_m[i] * d.edges_m[i + 1]));
    const at = (values) => values.map((v, i) => v === null ? null : [made.sx(middle[i]), made.sy(Math.min(v, top))]).filter(Boolean);
    made.marks.append(svg("path", { class: "band p" + k, d: pathOf([...at(d.low), ...at(d.high).reverse()]) + "Z" }),
      svg("path", { class: "curve p" + k, d: pathOf(at(d.median)) }));
  });
  const rows = found.flatMap((d) => d.n.map((n, i) => [d.label, d.edges_m[i], d.edges_m[i + 1], n, d.low[i], d.median[i], d.high[i]]));
  return plotFigure({ name: "depth-error-" + section.key, title: "Depth error against depth", root: made.root,
    keys: found.map((d, k) => ["p" + Math.min(k, 2), d.label]),
    head: ["side", "from, m", "to, m", "pixels", "10 %", "median", "90 %"], rows,
    note: "|aligned - ground truth| / ground truth over the drawn pixels of all scored photos: median, and from the " +
      "10th to the 90th percentile. Holes take no part." });
}

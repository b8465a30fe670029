/* What became of every prediction and every annotated object, in the field's words. */

export const WORDS = { tp: "true positive", fp: "false positive", fn: "missed", other: "not counted",
  truth: "ground truth", object: "scored objects" };
export const PLURALS = { tp: "true positives", fp: "false positives", fn: "missed",
  other: "not counted", truth: "ground truth" };
export const SIGNS = { tp: "", fp: "\u2715 ", fn: "? ", other: "\u00b7 ", truth: "", object: "" };
export const LAYERS = ["truth", "tp", "fp", "fn", "other"];

/** @typedef {{id: number, layer: string, side: number, shape: DrawnTruth, name: string, t: number|null,
 *   iou: number|null, what: string, score?: number, p?: number, object?: string}} Item */

function layerOf(outcome) { return outcome === "tp" || outcome === "fp" ? outcome : "other"; }

/**
 * Everything that is drawn; an item's id is its place in the list. least: of each side, the confidence below
 * which a prediction is not there, and what only such a one found is missed.
 * @param {DetectionPageView} view
 * @returns {Item[]}
 */
export function drawnItems(view, names, least = []) {
  const items = [];
  const add = (item) => items.push(Object.assign({ id: items.length, iou: null }, item));
  view.truths.forEach((truth, t) => {
    const ignored = view.sides.length && view.sides[0].truth[t] === "ignored";
    add({ layer: "truth", side: -1, shape: truth, name: names[truth.c], t,
      what: ignored ? "ground truth, not counted (crowd or ignored)" : "ground truth" });
  });
  view.sides.forEach((side, k) => {
    view.truths.forEach((truth, t) => {
      const finder = side.predictions.find((p) => p.o === "tp" && p.t === t && p.s < (least[k] || 0));
      const state = finder ? "below" : side.truth[t];
      if (finder) {
        add({ layer: "fn", side: k, shape: truth, name: names[truth.c], t,
          what: "missed at this confidence: what finds it has " + Number(finder.s.toFixed(3)) });
      }
      if (state !== "missed" && state !== "reached") { return; }
      add({ layer: "fn", side: k, shape: truth, name: names[truth.c], t,
        what: state === "missed" ? "missed" : "missed, but a false positive is about it" });
    });
    side.predictions.forEach((p, n) => {
      if (p.s < (least[k] || 0)) { return; }
      add({ layer: layerOf(p.o), side: k, shape: p, name: names[p.c], t: p.t, iou: p.i, score: p.s,
        p: n, object: p.n, what: whatOf(p, view, names) });
    });
  });
  return items;
}

function whatOf(p, view, names) {
  if (p.o === "tp") { return "true positive"; }
  if (p.o === "ignored") { return "not counted (on ignored ground truth)"; }
  if (p.o === "unverified") { return "not counted (category not annotated in this image)"; }
  if (p.o === "over_cap") { return "not counted (beyond the evaluator's cap)"; }
  return "false positive: " + p.k + (p.t === null ? "" : " (" + names[view.truths[p.t].c] + ")");
}

export function describe(item) {
  return item.name + ": " + item.what + (item.iou === null ? "" : ", IoU " + item.iou.toFixed(3)) +
    (item.score === undefined ? "" : ", confidence " + Number(item.score.toFixed(3))) +
    (item.object ? ", object " + item.object : "");
}

export function areaOf(item) { return item.shape.box[2] * item.shape.box[3]; }

/* In the order they are drawn: what is above can be pointed at. */
export function inDrawingOrder(items) {
  const order = ["truth", "other", "object", "tp", "fn", "fp"];
  return items.slice().sort((a, b) =>
    order.indexOf(a.layer) - order.indexOf(b.layer) || areaOf(b) - areaOf(a));
}

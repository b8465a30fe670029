/* A case of a bench: its panes, its scored objects, its checks. */

import { el, fixed, scroller, svg, table } from "./elements.js";
import { outlines, paneChoices, picture } from "./panes.js";
import { pointChoices } from "./points.js";
import { pictureUrl } from "./views.js";

/**
 * The scored objects of every side, as what can be pointed at.
 * @param {BenchPageView} view
 * @returns {import("./outcomes.js").Item[]}
 */
export function benchItems(view, names) {
  const n = view.objects.length;
  return view.sides.flatMap((side, k) => view.objects.map((shape, t) => {
    const score = side.objects[t];
    return { id: k * n + t, layer: "object", side: k, shape, name: shape.n, t, iou: null, object: names[shape.c],
      what: score ? whatOfScore(score) : "not compared" };
  }));
}

function whatOfScore(score) {
  if (!score.eligible) { return "not averaged: no reference point"; }
  return "F " + fixed(score.f1, 2) + ", precision " + fixed(score.precision, 2) + ", recall " + fixed(score.recall, 2);
}

/* Reference, then each submission's render, what R and A make of every pixel, and the surfaces. */
export function benchPanes(section, view, items, frames) {
  const size = view.size_wh;
  const photo = pictureUrl("photo", view.photo);
  const many = view.sides.length > 1;
  const rest = paneChoices(view, items, frames).filter((c) => !c.key.startsWith("side"));
  const points = pointChoices(view, section.bench.outcomes);
  const found = view.sides.flatMap((side, k) => {
    const of = many ? ": " + side.label : "";
    const over = (key, short, title, at, below, usual) => {
      const url = pictureUrl("overlay", at);
      return { key: key + k, short, title: short + of, usual, why: url ? "" : side.why_no_picture,
        make: () => frames.frame(title + of, [below, picture(url, size, { class: "pixels" }), outlines(items, k, size)]) };
    };
    const faded = photo ? picture(photo, size, { class: "faded" }) : null;
    const mine = (key) => rest.filter((c) => c.key === key + k);
    const made = [...mine("render").map((c) => Object.assign(c, { short: "render", title: "render" + of, usual: k === 0 })),
      over("hits", "hit and miss", "what R makes of every pixel", side.hit_picture, faded, k < 2),
      over("error", "error of A", "largest channel difference to the reference", side.error_picture, null, k === 0),
      Object.assign(points[k], { short: "surfaces in 3D", usual: k === 0 }),
      ...mine("slide").map((c) => Object.assign(c, { short: "reference | render", title: "reference | render" + of, usual: false })),
      ...mine("differ").map((c) => Object.assign(c, { short: "difference", title: "difference" + of, usual: false }))];
    return made.map((c) => Object.assign(c, { group: many ? side.label : "" }));
  });
  return [{ key: "reference", title: "reference", why: photo ? "" : view.said, usual: true, group: "",
    make: () => frames.frame("reference, with its scored objects", [picture(photo, size), outlines(items, 0, size)]) }, ...found];
}

/* What the colours of R's and A's pictures stand for. */
export function benchLegends(bench) {
  return el("div", {}, [swatches("hit and miss, surfaces: ", bench.outcomes.slice(1)),
    swatches("error of A, the largest channel difference of 255: ", bench.errors)]);
}

function swatches(title, outcomes) {
  return el("p", { class: "over swatches" }, [title, ...outcomes.map((o) => el("span", {}, [
    svg("svg", { viewBox: "0 0 10 10", width: 10, height: 10, "aria-hidden": "true" }, [
      svg("rect", { class: "sample", x: 0.5, y: 0.5, width: 9, height: 9, fill: o.colour })]), " " + o.text + " "]))]);
}

/* Each scored object of a side, the worst first. */
export function benchObjects(view, items, k) {
  const side = view.sides[k];
  if (!side.objects.length) { return []; }
  const names = Object.keys(side.objects[0].at);
  const mine = items.filter((item) => item.side === k).sort((a, b) => side.objects[a.t].f1 - side.objects[b.t].f1 || a.t - b.t);
  const rows = mine.map((item) => {
    const score = side.objects[item.t];
    const numbers = [score.f1, score.precision, score.recall, ...names.map((name) => score.at[name])];
    return el("tr", { "data-items": item.id }, [el("th", { scope: "row" }, [
      el("button", { type: "button", class: "pick", "data-items": item.id }, [item.name])]),
    el("td", {}, [item.object]), ...(score.eligible ? numbers.map((v) => el("td", { class: "n" }, [fixed(v)])) :
      [el("td", { colspan: numbers.length }, ["not averaged: no reference point"])]),
    el("td", { class: "n" }, [score.n_reference.toLocaleString("en")]),
    el("td", { class: "n" }, [score.n_submitted.toLocaleString("en")])]);
  });
  const head = ["object", "category", "F", "precision", "recall", ...names.map((name) => name.replace("_", " ")), "reference points", "submitted points"];
  return [el("div", { class: "objects" }, [scroller(el("table", {}, [
    el("thead", {}, [el("tr", {}, head.map((text, i) => el("th", { scope: "col", class: i > 1 ? "n" : null }, [text])))]),
    el("tbody", {}, rows)]), "scored objects of " + side.label)])];
}

/* V's checks, folded where all of them passed. */
export function benchChecks(side) {
  if (!side.checks.length) { return el("p", { class: "sub" }, ["No validity check is on record."]); }
  const failed = side.checks.filter((c) => !c.ok).length;
  const rows = side.checks.map((c) => [c.name, c.ok ? "passed" : "failed", c.found || "-", c.expected || "-", c.next_step || "-"]);
  return el("details", { open: failed > 0 }, [
    el("summary", {}, [side.label + ": validity, " + (failed ? failed + " of " + rows.length + " checks failed" : "all " + rows.length + " checks passed")]),
    table(["check", "outcome", "found", "expected", "next step"], rows, "validity of " + side.label)]);
}

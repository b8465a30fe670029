/* What is wrong with a photo and what helps, and its objects as a folded table. */

import { counted, el, fixed, scroller, table } from "./elements.js";
import { PLURALS, WORDS } from "./outcomes.js";

const MOST_FINDINGS = 8;
const MOST_OPEN = 12;

/* A side's numbers in a line. */
export function scoreLine(cell, n_truth, label) {
  const parts = [];
  if (label) { parts.push(el("b", { class: "who" }, [label]), " "); }
  if (cell.status !== "ok") { parts.push(el("span", { class: "flag" }, [cell.status]), " "); }
  if (cell.valid !== undefined) {
    const numbers = ["S", "R", "A"].flatMap((name) => [name + " ", el("b", {}, [fixed(cell[name])]), name === "A" ? "" : ", "]);
    parts.push(...numbers, cell.valid ? ", valid" : el("span", { class: "flag" }, [", not valid"]));
  } else if (cell.counts) {
    parts.push(cell.metric + " of this photo ", el("b", {}, [fixed(cell.quality, 4)]));
  } else if (cell.tp !== undefined) {
    parts.push(cell.tp + " of " + counted(n_truth, "object", "objects") + " detected, ",
      counted(cell.fp, "false positive", "false positives") + ", " + cell.fn + " missed; quality ",
      el("b", {}, [fixed(cell.quality)]));
  } else if (cell.accuracy !== undefined) {
    parts.push(cell.answered + " of " + counted(n_truth, "question", "questions") + " answered; accuracy ",
      el("b", {}, [fixed(cell.accuracy)]));
  } else {
    parts.push("AbsRel ", el("b", {}, [cell.abs_rel ? fixed(cell.abs_rel.error_1, 4) : "-"]),
      ", a constant " + fixed(cell.constant, 4) +
      (cell.holes === null ? "" : ", holes " + (100 * cell.holes).toFixed(1) + " %"));
  }
  return el("p", { class: "score-line" }, parts);
}

export function findingsOf(side, k, items, many, about) {
  const list = side.advice.map((advice) => {
    const ids = itemsOf(advice, k, items);
    const text = [advice.what, advice.do ? el("span", { class: "do" }, [advice.do]) : null];
    const attributes = { class: "a-" + advice.level };
    if (!ids.length) { return el("li", attributes, text); }
    return el("li", attributes, [el("button", { type: "button", class: "pick",
      "data-items": ids.join(" ") }, text)]);
  });
  const rest = list.splice(MOST_FINDINGS);
  if (side.advice.every((a) => a.level === "note")) {
    list.unshift(el("li", {}, ["nothing to complain about"]));
  }
  const title = about.scene && !side.checks ? "What to do next" : "Findings";
  return [el("h3", {}, [many ? side.label + ": " + title.toLowerCase() : title]),
    el("ul", { class: "advice" }, list),
    rest.length ? el("details", {}, [el("summary", {}, [rest.length + " more"]),
      el("ul", { class: "advice" }, rest)]) : null];
}

function itemsOf(advice, k, items) {
  return items.filter((item) => {
    if (item.side !== k) { return false; }
    if (item.p !== undefined) { return advice.predictions.includes(item.p); }
    return advice.truths.includes(item.t) && !advice.predictions.length;
  }).map((item) => item.id);
}

/* Every prediction and every missed object, by outcome; pointing at a row lights it up. */
export function objectsOf(view, items, k) {
  const mine = items.filter((item) => item.side === k);
  const order = ["fn", "fp", "tp", "other"];
  return order.filter((layer) => mine.some((item) => item.layer === layer)).map((layer) => {
    const rows = mine.filter((item) => item.layer === layer).sort((a, b) =>
      a.name < b.name ? -1 : a.name > b.name ? 1 : (b.iou || 0) - (a.iou || 0));
    const title = rows.length + " " + (rows.length === 1 ? WORDS : PLURALS)[layer];
    const open = (layer === "fn" || layer === "fp") && rows.length <= MOST_OPEN;
    return el("details", { class: "objects", open }, [
      el("summary", {}, [el("span", { class: "key k-" + layer }), " " + title + " ",
        el("span", { class: "sub" }, [tally(rows)])]),
      scroller(el("table", {}, [head(), el("tbody", {}, rows.map(rowOf))]), title)]);
  });
}

function head() {
  return el("thead", {}, [el("tr", {}, ["category", "outcome", "IoU", "score", "object"].map((text, i) =>
    el("th", { scope: "col", class: i === 2 || i === 3 ? "n" : null }, [text])))]);
}

function rowOf(item) {
  const score = item.score === undefined ? "-" : String(Number(item.score.toFixed(3)));
  return el("tr", { "data-items": item.id }, [
    el("th", { scope: "row" }, [el("button", { type: "button", class: "pick", "data-items": item.id },
      [item.name])]),
    el("td", {}, [item.what]), el("td", { class: "n" }, [fixed(item.iou)]),
    el("td", { class: "n" }, [score]), el("td", {}, [item.object || "-"])]);
}

function tally(rows) {
  const counts = new Map();
  rows.forEach((item) => counts.set(item.name, (counts.get(item.name) || 0) + 1));
  return Array.from(counts).sort((a, b) => b[1] - a[1]).slice(0, 6)
    .map(([name, n]) => (n > 1 ? n + " " : "") + name).join(", ") + (counts.size > 6 ? ", ..." : "");
}

/* What the run recorded: camera, sizes, hashes, and labels that led to nothing. */
export function recordOf(side, what) {
  const pairs = side.facts.flatMap((f) => [el("dt", {}, [f[0]]), el("dd", {}, [f[1]])]);
  const tables = side.tables.map((t) => el("details", {}, [
    el("summary", {}, [t.title + " (" + t.rows.length + ")"]), table(t.head, t.rows, t.title)]));
  return el("div", {}, [...tables, el("details", {}, [
    el("summary", {}, [side.label + ": " + what]), el("dl", { class: "facts" }, pairs)])]);
}


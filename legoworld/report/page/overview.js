/* The first screen: the main metrics with their intervals, the coverage, the worst photos. */

import { plotFigure } from "./chart.js";
import { confidenceOf } from "./cohorts.js";
import { counted, el, fixed, svg } from "./elements.js";
import { card } from "./gallery.js";
import { tierFigures } from "./tiers.js";
import { sectionElement } from "./views.js";
import { worst } from "./worst.js";

const SHEET = 12;
const LINE = 21;
const NAMES = 148;
const DRAWN = new Map();

/** @param {PageSection} section
 * @param {boolean} [printed] at once, without what takes time */
export function overview(section, printed = false) {
  const root = sectionElement(section.key);
  const conf = confidenceOf(section);
  const before = DRAWN.get(section.key);
  if (before && before.conf === conf) { return; }
  const drawn = { conf, close: () => {} };
  DRAWN.set(section.key, drawn);
  const [large, sheet] = [root.querySelector("[data-worst]"), root.querySelector("[data-sheet]")];
  if (before) {
    before.close();
    [large, sheet].forEach((host) => host && host.replaceChildren());
  }
  if (large) { drawn.close = worst(section, large, printed); }
  if (sheet) { sheet.append(...section.images.slice(0, SHEET).map((row) => card(section, row, {}))); }
  if (before) { return; }
  const forest = root.querySelector("[data-forest]");
  if (section.bench) { root.querySelector("[data-tiers]").append(...tierFigures(section)); }
  if (section.first.forest.length) { forest.append(forestFigure(section)); }
  root.querySelector("[data-coverage]").append(...section.first.coverage.map((bar) => coverageBar(bar, Boolean(section.bench))));
}

function labelsOf(section) {
  if (section.sides.length) { return section.sides.map((s) => s.label); }
  return ["scene", ...section.first.verdicts.map((_, k) => "baseline " + (k + 1))];
}

/* Values of the sides on one axis, differences on another: points with their intervals. */
function forestFigure(section) {
  const rows = section.first.forest;
  const labels = labelsOf(section);
  const many = rows.some((r) => r.differences.some(Boolean));
  const pairs = rows.reduce((n, r) => Math.max(n, r.differences.length), 0);
  const names = section.bench ? 30 : NAMES;
  const width = section.bench ? (many ? 470 : 420) : many ? 700 : 520;
  const values = { left: names, right: many ? width - 270 + (section.bench ? 36 : 0) : width - 66 };
  const differences = { left: values.right + 64, right: width - 18 };
  const line = Math.max(LINE, 11 * labels.length + 5);
  const high = rows.length * line + 46;
  const lines = rows.flatMap((row, i) => rowMarks(row, 22 + i * line + line / 2, values, many ? differences : null, reach(rows), top(rows)));
  const root = svg("svg", { class: "chart forest", viewBox: "0 0 " + width + " " + high, role: "img",
    "aria-label": "main metrics of " + labels.join(" and ") + " with 95 % intervals" }, [
    ...axis(values, 0, top(rows), [0, 0.25, 0.5, 0.75, 1].map((v) => v * top(rows)), high, ""),
    ...(many ? axis(differences, -reach(rows), reach(rows), [-reach(rows), 0, reach(rows)], high, "+") : []),
    svg("text", { class: "axis", x: values.left, y: 13 }, ["value"]),
    many ? svg("text", { class: "axis", x: differences.left, y: 13 }, [differenceAxis(rows)]) : null,
    ...lines]);
  const table = rows.flatMap((row) => [
    ...row.sides.map((s, k) => [row.name, labels[k], ...numbers(s), s ? s.over : ""]),
    ...row.differences.map((s, k) => [row.name, labels[0] + " minus " + labels[k + 1], ...numbers(s), s ? s.over : ""])]);
  return plotFigure({ name: "metrics-" + section.key, title: "Main metrics" + denominator(section), root,
    keys: labels.map((label, k) => ["side-key-" + Math.min(k, 2), label]),
    note: intervalNote(rows, pairs > 0, Boolean(section.bench)),
    head: ["metric", "of", "value", "low", "high", "over"], rows: table });
}

/* What all values are over, where that is one; else of all attempted, or each side's own images. */
function denominator(section) {
  const overs = new Set(section.first.forest.flatMap((r) => r.sides.filter(Boolean).map((s) => s.over)));
  const attempted = section.first.coverage.map((bar) => bar.attempted)[0];
  if (overs.size === 1 && !overs.has("")) { return " over " + Array.from(overs)[0]; }
  if (section.pixels) { return ", each over its own images"; }
  return attempted ? " over all " + counted(attempted, section.bench ? "case" : "image", section.bench ? "cases" : "images") + " attempted" : "";
}

/* The images that all differences are of. */
function differenceAxis(rows) {
  const overs = new Set(rows.flatMap((r) => r.differences.filter(Boolean).map((d) => d.over)));
  return "difference" + (overs.size === 1 ? ", " + Array.from(overs)[0] : "");
}

function intervalNote(rows, compared, bench) {
  const spans = rows.flatMap((r) => [...r.sides, ...r.differences]);
  if (!spans.some((span) => span && span.low !== null)) {
    return bench ? "No intervals: they need two families or more." : "No intervals.";
  }
  return "95 % intervals" + (compared ? "; a difference whose interval contains 0 does not tell the sides apart." : ".");
}

function numbers(span) { return span ? [fixed(span.value, 4), fixed(span.low, 4), fixed(span.high, 4)] : ["-", "-", "-"]; }

/* The end of the axis of differences: a round number that all of them fit in. */
function reach(rows) {
  const ends = rows.flatMap((r) => r.differences.filter(Boolean).flatMap((d) => [d.value, d.low, d.high]))
    .filter((v) => v !== null).map(Math.abs);
  const most = Math.max(0.1, ...ends);
  return [0.1, 0.2, 0.25, 0.4, 0.5, 0.6, 0.8, 1].find((end) => end >= most) || Math.ceil(most);
}

/* The end of the axis of values: 1, or a round number above what is no fraction. */
function top(rows) {
  const ends = rows.flatMap((r) => r.sides.filter(Boolean).flatMap((s) => [s.value, s.high]))
    .filter((v) => v !== null);
  return Math.ceil(Math.max(1, ...ends));
}

function axis(at, from, to, ticks, high, sign) {
  return ticks.flatMap((v) => {
    const x = at.left + (v - from) / (to - from) * (at.right - at.left);
    return [svg("line", { class: v === 0 && sign ? "zero" : "grid", x1: x, x2: x, y1: 20, y2: high - 22 }),
      svg("text", { class: "tick", x, y: high - 8, "text-anchor": "middle" }, [(v > 0 ? sign : "") + v])];
  });
}

function rowMarks(row, y, values, differences, end, most) {
  const n = row.sides.length;
  const place = (v) => values.left + Math.min(Math.max(v / most, 0), 1) * (values.right - values.left);
  const marks = [svg("text", { class: "name", x: 0, y: y + 4 }, [row.name + (row.better === "lower" ? " \u2193" : "")])];
  row.sides.forEach((span, k) => {
    if (!span || span.value === null) { return; }
    const at = y + (k - (n - 1) / 2) * 11;
    marks.push(...interval(span, at, place, k),
      svg("text", { class: "value v" + Math.min(k, 2), x: values.right + 8, y: at + 4 }, [fixed(span.value)]));
  });
  if (differences) {
    const middle = (differences.left + differences.right) / 2;
    const d = (v) => middle + v / end * (differences.right - differences.left) / 2;
    row.differences.forEach((span, k) => {
      if (!span || span.value === null) { return; }
      const apart = span.low !== null && (span.low > 0 || span.high < 0);
      marks.push(...interval(span, y + (k - (row.differences.length - 1) / 2) * 11, d, apart ? "apart" : "same"));
    });
  }
  return marks;
}

function interval(span, y, place, kind) {
  const cls = typeof kind === "number" ? "f" + Math.min(kind, 2) : "f-" + kind;
  const ends = span.low === null ? [] : [svg("line", { class: "whisker " + cls, x1: place(span.low), x2: place(span.high), y1: y, y2: y })];
  const x = place(span.value);
  const said = fixed(span.value, 4) + (span.low === null ? "" : " [" + fixed(span.low, 4) + ", " + fixed(span.high, 4) + "]");
  const title = svg("title", {}, [said + (span.over ? ", " + span.over : "")]);
  const mark = kind === 1 ? svg("rect", { class: "point " + cls, x: x - 4, y: y - 4, width: 8, height: 8 }, [title])
    : svg("circle", { class: "point " + cls, cx: x, cy: y, r: 4.5 }, [title]);
  return [...ends, mark];
}

/* All attempted images of a side as one bar. */
function coverageBar(bar, cases) {
  const parts = bar.parts.filter((p) => p.n);
  const said = parts.map((p) => p.n + " " + p.name).join(", ");
  return el("div", { class: "coverage" }, [
    el("div", { class: "coverage-head" }, [el("b", {}, [bar.label]), " " + counted(bar.attempted, cases ? "case" : "image", cases ? "cases" : "images") + " attempted: " + said]),
    el("div", { class: "coverage-bar", role: "img", "aria-label": bar.label + ": " + said }, parts.map((p) =>
      el("span", { class: "c-" + p.sort, style: "flex-grow:" + p.n, title: p.n + " " + p.name })))]);
}

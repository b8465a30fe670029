/* A bench's tiers as nested bars: each tier holds the objects of the one before, so the thin bar of
   the hard tier lies inside the broad one of the easy tier. */

import { plotFigure } from "./chart.js";
import { el, fixed, svg } from "./elements.js";

const THICK = [24, 15, 6];
const ROW = 40;
const MOST_ROWS = 12;

/** @param {PageSection} section */
export function tierFigures(section) {
  const bars = section.bench.tiers;
  const metrics = Array.from(new Set(bars.map((b) => b.metric)));
  if (!metrics.length) { return [el("p", { class: "sub" }, ["These cases have no tiers."])]; }
  const rows = metrics.flatMap((metric) => bars.filter((b) => b.metric === metric).slice(0, MOST_ROWS));
  const many = new Set(bars.map((b) => b.label)).size > 1;
  const left = many ? 128 : 30;
  const [width, right] = [420, 300];
  const high = rows.length * ROW + 28;
  const tiers = bars[0].tiers;
  const ticks = [0, 0.25, 0.5, 0.75, 1].flatMap((v) => {
    const x = left + v * (right - left);
    return [svg("line", { class: "grid", x1: x, x2: x, y1: 2, y2: high - 22 }),
      svg("text", { class: "tick", x, y: high - 8, "text-anchor": "middle" }, [v])];
  });
  const marks = rows.flatMap((bar, i) => nested(bar, 2 + i * ROW + ROW / 2, left, right, many));
  const root = svg("svg", { class: "chart tiers", viewBox: "0 0 " + width + " " + high, role: "img",
    "aria-label": "scores by tier" }, [...ticks, ...marks]);
  const lines = bars.flatMap((b) => b.tiers.map((tier, i) => [b.label, b.metric, tier, b.cases[i], fixed(b.values[i], 4), fixed(b.sds[i], 4)]));
  return [plotFigure({ name: "tiers-" + section.key, title: "By tier", root,
    keys: tiers.map((tier, i) => ["tier-" + i, tier + ", " + bars[0].cases[i] + (bars[0].cases[i] === 1 ? " case" : " cases")]),
    note: "Tiers are nested: each holds the objects of the one before. Numbers at the right: " + tiers.join(", ") + ".",
    head: ["row", "metric", "tier", "cases", "mean", "sd over runs"], rows: lines })];
}

function nested(bar, y, left, right, many) {
  const text = many ? cutName(bar.label) : "";
  const name = svg("text", { class: "name", x: left - 8, y: y + 4, "text-anchor": "end" }, [
    svg("title", {}, [bar.label]), text + (many ? "  " : "") + bar.metric]);
  const boxes = bar.values.map((value, i) => value === null ? null : svg("rect", { class: "tier tier-" + Math.min(i, 2),
    x: left, y: y - THICK[Math.min(i, 2)] / 2, width: Math.max(value * (right - left), 1), height: THICK[Math.min(i, 2)] }, [
    svg("title", {}, [bar.label + ", " + bar.metric + ", " + bar.tiers[i] + ": " + fixed(value, 4)])]));
  return [name, ...boxes, svg("text", { class: "tick", x: right + 10, y: y + 4 }, [bar.values.map((v) => fixed(v, 2)).join("  ")])];
}

function cutName(name) { return name.length > 15 ? name.slice(0, 14) + "\u2026" : name; }

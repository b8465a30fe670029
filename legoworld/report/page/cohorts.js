/* A selection of photos, scored as the evaluator scores all of them: from every prediction's outcome
   at every size and threshold, accumulated by category in falling order of score. */

import { fileButtons, save } from "./chart.js";
import { button, counted, el, fixed } from "./elements.js";
import { here, moveTo } from "./place.js";
import { bytesOf } from "./views.js";

const DECODED = new Map();
const RECALLS = 101;
const [DRAWS, AP_DRAWS, MOST_STEPS] = [1000, 200, 4e7];

/* A column's whole numbers; its first sign says of how many bytes. */
function numbersOf(text) { return new { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }[text[0]](bytesOf(text.slice(1)).buffer); }

/** The outcomes of a side, decoded when they are first asked for.
 * @param {PageSection} section
 * @returns {any} */
function matchesOf(section, k) {
  const key = section.key + " " + k;
  if (DECODED.has(key)) { return DECODED.get(key); }
  const side = section.cohorts.sides[k];
  const starts = new Uint32Array(section.cohorts.categories.length + 1);
  side.above[0].forEach((n, c) => { starts[c + 1] = starts[c] + n; });
  const made = { starts, width: section.cohorts.areas.length * section.cohorts.thresholds };
  ["image", "outcome", "outcomes", "truth_image", "truth_category", "n_truths"].forEach((name) => { made[name] = numbersOf(side[name]); });
  DECODED.set(key, made);
  return made;
}

/* Below it nothing is drawn or counted: what the address says, else what suits ranked predictions. */
export function confidenceOf(section, place = here()) {
  const of = section.cohorts;
  if (!of || !of.sides.some((s) => s.ranked)) { return 0; }
  return (place.conf ? of.confidences[Math.round(Number(place.conf) / of.confidences[1])] : of.usual) ?? of.usual;
}

/* How many predictions of each category count from a confidence on: the first of its own. */
function aboveOf(of, side, conf) { return side.above[side.ranked ? 1 + of.confidences.indexOf(conf) : 0]; }

/* Of each side; one whose predictions are all as confident has none. */
export function leastOf(section) {
  return section.cohorts ? section.cohorts.sides.map((side) => side.ranked ? confidenceOf(section) : 0) : [];
}

/* True, false and scored objects of each image at IoU 0.5, of predictions at a confidence or above. */
export function countsOf(section, k, { area = 0, category = -1, conf = 0 }) {
  const [of, m] = [section.cohorts, matchesOf(section, k)];
  const [tp, fp, n] = [0, 1, 2].map(() => new Float64Array(of.images.length));
  const at = area * of.thresholds + of.half;
  aboveOf(of, of.sides[k], conf).forEach((many, c) => {
    if (category >= 0 && c !== category) { return; }
    for (let d = m.starts[c]; d < m.starts[c] + many; d += 1) {
      const outcome = m.outcomes[m.outcome[d] * m.width + at];
      if (outcome < 2) { (outcome ? tp : fp)[m.image[d]] += 1; }
    }
  });
  const cells = m.truth_image.length;
  for (let c = 0; c < cells; c += 1) {
    if (category < 0 || m.truth_category[c] === category) { n[m.truth_image[c]] += m.n_truths[area * cells + c]; }
  }
  return { tp, fp, n };
}

/* AP and AP50 with image i counted weights[i] times; null where no object is scored. */
function apOf(section, k, weights, { area = 0, category = -1 }) {
  const [of, m] = [section.cohorts, matchesOf(section, k)];
  const cells = m.truth_image.length;
  const n = new Float64Array(of.categories.length);
  for (let c = 0; c < cells; c += 1) { n[m.truth_category[c]] += weights[m.truth_image[c]] * m.n_truths[area * cells + c]; }
  let [sum, half, many] = [0, 0, 0];
  for (let c = 0; c < n.length; c += 1) {
    if (!n[c] || (category >= 0 && c !== category)) { continue; }
    many += 1;
    for (let t = 0; t < of.thresholds; t += 1) {
      const ap = averagePrecision(m, weights, area * of.thresholds + t, m.starts[c], m.starts[c + 1], n[c]);
      sum += ap / of.thresholds;
      if (t === of.half) { half += ap; }
    }
  }
  return many ? { ap: sum / many, ap50: half / many } : { ap: null, ap50: null };
}

function averagePrecision(m, weights, at, from, to, n) {
  const [recall, precision] = [[], []];
  let [tp, fp] = [0, 0];
  for (let d = from; d < to; d += 1) {
    const w = weights[m.image[d]];
    const outcome = w ? m.outcomes[m.outcome[d] * m.width + at] : 2;
    if (outcome === 2) { continue; }
    if (outcome) { tp += w; } else { fp += w; }
    recall.push(tp / n);
    precision.push(tp / (tp + fp + Number.EPSILON));
  }
  for (let i = precision.length - 2; i >= 0; i -= 1) { precision[i] = Math.max(precision[i], precision[i + 1]); }
  let [sum, reached] = [0, 0];
  for (let r = 0; r < RECALLS; r += 1) {
    const wanted = r === RECALLS - 1 ? 1 : r * 0.01;
    while (reached < recall.length && recall[reached] < wanted) { reached += 1; }
    if (reached === recall.length) { break; }
    sum += precision[reached];
  }
  return sum / RECALLS;
}

/* mulberry32: the same draws every time. */
function randomFrom(seed) {
  let a = seed;
  return () => {
    a = a + 0x6D2B79F5 | 0;
    let t = Math.imul(a ^ a >>> 15, 1 | a);
    t = t + Math.imul(t ^ t >>> 7, 61 | t) ^ t;
    return ((t ^ t >>> 14) >>> 0) / 4294967296;
  };
}

function ends(values) {
  const known = values.filter((v) => v !== null).sort((a, b) => a - b);
  const at = (q) => known[Math.min(Math.floor(q * known.length), known.length - 1)];
  return known.length ? [at(0.025), at(0.975)] : [null, null];
}

/* A value of each of many draws of the places, with replacement. */
function drawn(places, draws, value) {
  const random = randomFrom(1);
  const picked = new Uint32Array(places.length);
  return Array.from({ length: draws }, () => {
    for (let i = 0; i < picked.length; i += 1) { picked[i] = places[Math.floor(random() * places.length)]; }
    return value(picked);
  });
}

/* Every number of a selection with its interval over images. */
function rescored(section, k, rows, choice) {
  const of = section.cohorts;
  const placeOf = new Map(of.images.map(([id], i) => [id, i]));
  const places = rows.map((row) => placeOf.get(row.id)).filter((i) => i !== undefined);
  const { tp, fp, n } = countsOf(section, k, choice);
  const sums = (picked) => {
    let [found, wrong, objects] = [0, 0, 0];
    for (const i of picked) { found += tp[i]; wrong += fp[i]; objects += n[i]; }
    const ratio = (whole) => whole ? found / whole : null;
    return { tp: found, fp: wrong, objects, precision: ratio(found + wrong), recall: ratio(objects) };
  };
  const scored = (picked) => {
    const weights = new Float64Array(of.images.length);
    for (const i of picked) { weights[i] += 1; }
    return apOf(section, k, weights, choice);
  };
  const draws = places.length < 2 ? [] : drawn(places, DRAWS, sums);
  const few = places.length < 2 || matchesOf(section, k).image.length * of.thresholds * AP_DRAWS > MOST_STEPS;
  return { ...sums(places), ...scored(places), ap_ends: ends(few ? [] : drawn(places, AP_DRAWS, (picked) => scored(picked).ap)),
    precision_ends: ends(draws.map((d) => d.precision)), recall_ends: ends(draws.map((d) => d.recall)) };
}

/* What the address selects of a section's matches. */
export function choiceOf(section, place) {
  const of = section.cohorts;
  return { area: Math.max(of.areas.indexOf(place.size), 0), conf: confidenceOf(section, place),
    category: place.cat ? of.categories.findIndex(([id]) => String(id) === place.cat) : -1 };
}

/** A line of numbers for each side, and the selection as a track.
 * @param {PageSection} section */
export function cohortLines(section, rows, place) {
  const choice = choiceOf(section, place);
  const many = section.sides.length > 1;
  const sides = section.sides.map((_, k) => rescored(section, k, rows, choice));
  const lines = section.sides.map((side, k) => {
    const found = sides[k];
    const span = (name, value, between) => [name + " ", el("b", { "data-number": name, "data-value": value }, [fixed(value)]),
      between && between[0] !== null ? " [" + fixed(between[0]) + ", " + fixed(between[1]) + "]" : ""];
    return el("p", { class: "cohort-line", "data-side": k }, [many ? el("b", {}, [side.label + ": "]) : null,
      ...span("AP", found.ap, found.ap_ends), ", ", ...span("AP50", found.ap50), "; ",
      ...span("precision", found.precision, found.precision_ends), " and ", ...span("recall", found.recall, found.recall_ends),
      ": " + found.tp + " of " + counted(found.objects, "object", "objects") + " found, " + counted(found.fp, "false positive", "false positives")]);
  });
  const what = counted(rows.length, "photo", "photos") + (choice.category < 0 ? "" : ", " + section.cohorts.categories[choice.category][1]) +
    (choice.area ? ", " + place.size : "") + (place.tag ? ", tag " + place.tag : "") + (choice.conf ? "; counts at confidence " + choice.conf + " or above, IoU 0.5" : "; counts at IoU 0.5");
  const cell = (value, between) => fixed(value) + (between && between[0] !== null ? " [" + fixed(between[0]) + ", " + fixed(between[1]) + "]" : "");
  const table = [["system", "AP", "AP50", "precision", "recall", "found", "objects", "false positives"], ...sides.map((s, k) => [section.sides[k].label,
    cell(s.ap, s.ap_ends), cell(s.ap50), cell(s.precision, s.precision_ends), cell(s.recall, s.recall_ends), s.tp, s.objects, s.fp])];
  return [...lines, el("p", { class: "sub" }, [what + ". 95 % intervals over photos. ",
    fileButtons({ name: section.task + "-selection", title: section.title + ", selection", note: what + ". 95 % intervals over photos", rows: table, root: null }), " ",
    button("save as a track", () => save(section.task + "-selection.json", "application/json", JSON.stringify(trackOf(section, rows))))])];
}

/* The public half of the selection, as `legoworld readout --track` takes it. */
function trackOf(section, rows) {
  const sizes = new Map(section.cohorts.images.map(([id, width, height]) => [id, { width, height }]));
  return { info: { task: section.task }, images: rows.map((row) => ({ id: row.id, file_name: row.file_name, ...sizes.get(row.id) })),
    categories: section.cohorts.categories.map(([id, name]) => ({ id, name })) };
}

/** Where predictions begin to count.
 * @param {PageSection} section */
export function confidenceSlider(section) {
  const conf = confidenceOf(section);
  const [of, sum] = [section.cohorts, (rows) => rows.flat().reduce((all, n) => all + n, 0)];
  const ranked = of.sides.filter((side) => side.ranked);
  const [shown, all] = [sum(ranked.map((side) => aboveOf(of, side, conf))), sum(ranked.map((side) => side.above[0]))];
  return el("label", { class: "confidence" }, ["confidence ", el("input", { type: "range", min: 0, max: 1, step: of.confidences[1], value: conf, "data-keep": "conf",
    onchange: (event) => moveTo({ conf: event.target.value }) }), el("span", { class: "over" }, [" " + conf.toFixed(2) + " or above: " +
    shown.toLocaleString("en") + " of " + counted(all, "prediction", "predictions")])]);
}

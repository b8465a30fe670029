/* Photos as cards, worst first: only those near the window exist, so 5,000 scroll like 50. */

import { choiceOf, cohortLines, confidenceOf, countsOf, leastOf } from "./cohorts.js";
import { depthErrorUrl } from "./depth.js";
import { el, fixed, svg } from "./elements.js";
import { areaOf, drawnItems, inDrawingOrder } from "./outcomes.js";
import { here, moveTo } from "./place.js";
import { shapePath } from "./shapes.js";
import { pictureUrl, sectionElement, sectionOf, withView } from "./views.js";

const CARD_WIDTH = 208;
const GAP = 12;
const CAPTION = 42;
const MARK = 16;
const MOST_MARKS = 3;
const BEYOND = 500;

/** What a section's photos are, sorted and filtered as the address says.
 * @type {{key: string, drawn: string, rows: PhotoRow[]}} */
const LISTED = { key: "", drawn: "", rows: [] };

function quality(row, k) {
  const cell = /** @type {any} */ (row.cells[k]);
  if (!cell) { return null; }
  if (cell.valid !== undefined) { return cell.S === null ? cell.R : cell.S; }
  if (cell.quality !== undefined) { return cell.quality; }
  if (cell.accuracy !== undefined) { return cell.accuracy; }
  return cell.score === null ? null : -cell.score;
}

/* Which side has the better quality: "0", "1", ... or "tie"; a side without a score loses. */
function winner(row) {
  const values = row.cells.map((_, k) => {
    const q = quality(row, k);
    return q === null ? -Infinity : q;
  });
  const best = Math.max(...values);
  const first = values.indexOf(best);
  return values.lastIndexOf(best) === first ? String(first) : "tie";
}

/**
 * Orders by their names in the address, with a title and a row's value; rows without one come last.
 * @param {PageSection} section
 * @returns {[string, string, ((row: PhotoRow) => any) | null][]}
 */
export function orders(section) {
  const pixels = Boolean(section.pixels);
  const many = section.sides.length > 1;
  const cell = (r, k) => /** @type {any} */ (r.cells[k]);
  /** @type {[string, string, ((row: PhotoRow) => any) | null][]} */
  const found = [["", many ? "worst of " + section.sides[0].label : "worst first", null]];
  section.sides.forEach((side, k) => {
    const of = many ? " of " + side.label : "";
    if (k) { found.push(["q" + k, "worst" + of, (r) => quality(r, k)]); }
    found.push(["-q" + k, "best" + of, (r) => quality(r, k)]);
    if (section.bench) {
      found.push(["r" + k, "lowest R" + of, (r) => cell(r, k).R], ["a" + k, "lowest A" + of, (r) => cell(r, k).A]);
    } else if (section.images.some((r) => cell(r, k).counts)) {
      return;
    } else if (pixels) {
      found.push(["-hole" + k, "most holes" + of, (r) => cell(r, k).holes]);
    } else if (section.family !== "relations") {
      found.push(["-fn" + k, "most missed" + of, (r) => cell(r, k).fn]);
      found.push(["-fp" + k, "most false positives" + of, (r) => cell(r, k).fp]);
    }
  });
  if (many) {
    const gap = (r) => {
      const [a, b] = [quality(r, 0), quality(r, 1)];
      return a === null || b === null ? null : a - b;
    };
    found.push(["gap", section.sides[0].label + " loses most", gap]);
    found.push(["-gap", section.sides[0].label + " wins most", gap]);
  }
  found.push(["-truth", pixels ? "most valid pixels" : "most objects", (r) => r.n_truth]);
  found.push(["file", "file name", (r) => r.file_name]);
  return found;
}

function sorted(rows, section, name) {
  const order = orders(section).find((o) => o[0] === name);
  if (!order || !order[2]) { return rows; }
  const value = order[2];
  const sign = name[0] === "-" ? -1 : 1;
  const keyed = rows.map((row, i) => ({ row, i, v: value(row) }));
  keyed.sort((a, b) => {
    if ((a.v === null) !== (b.v === null)) { return a.v === null ? 1 : -1; }
    return (a.v < b.v ? -sign : a.v > b.v ? sign : 0) || a.i - b.i;
  });
  return keyed.map((one) => one.row);
}

/** @param {PhotoRow} row */
function keeps(row, place, q) {
  if (q && !row.file_name.toLowerCase().includes(q)) { return false; }
  if (place.status && !row.cells.some((c) => c.status === place.status)) { return false; }
  if (place.wins && winner(row) !== place.wins) { return false; }
  const one = /** @type {any} */ (row);
  if (place.tier && one.tier !== place.tier) { return false; }
  if (place.flag && !one.cells.some((c) => c.flags && c.flags.includes(place.flag))) { return false; }
  const cat = place.cat ? Number(place.cat) : null;
  const cells = row.cells.filter((_, k) => !place.of || String(k) === place.of);
  if (place.kind === "failed") { return cells.some((/** @type {any} */ c) => c.status !== "ok" || c.valid === false); }
  if (place.kind) {
    return cells.some((/** @type {any} */ c) => ((c.errors || {})[place.kind] || []).some((id) => cat === null || id === cat));
  }
  return cat === null || row.categories.includes(cat);
}

export function listed(section, place) {
  const q = place.q.toLowerCase();
  const sized = section.cohorts && place.size ? countsOf(section, 0, choiceOf(section, place)).n : null;
  const large = new Set((section.cohorts ? section.cohorts.images : []).filter((_, i) => sized && sized[i]).map(([id]) => id));
  const ids = section.tags.find(([tag]) => tag === place.tag);
  const tagged = place.tag ? new Set(ids ? ids[1] : []) : null;
  const rows = section.images.filter((row) => keeps(row, place, q) && (!sized || large.has(row.id)) && (!tagged || tagged.has(row.id)));
  return sorted(rows, section, place.sort);
}

/* The photos as listed now, and where the open one is among them. */
export function neighbours() {
  const place = here();
  const section = sectionOf(place.section);
  const ids = listed(section, place).map((r) => String(r.id));
  return { ids, n: ids.length, at: ids.indexOf(place.image) };
}

export function step(by) {
  const around = neighbours();
  const next = around.at < 0 ? (by > 0 ? 0 : around.n - 1) : around.at + by;
  if (next >= 0 && next < around.n) { moveTo({ image: around.ids[next] }); }
}

/* A photo with its outlines, a quality number and what became of its objects. */
export function card(section, row, attributes) {
  const picture = el("span", { class: "thumb" });
  const many = section.sides.length > 1;
  const marks = row.cells.slice(0, MOST_MARKS).map((cell, k) => markOf(atConfidence(section, row, k, cell), many ? shortName(section.sides[k].label) : ""));
  const first = row.cells[0];
  const said = first.status === "ok" ? first.advice : first.status + (first.advice ? ": " + first.advice : "");
  const made = el("a", Object.assign({ class: "card", href: "#/" + section.key + "/" + row.id,
    "data-image": row.id }, attributes), [picture,
    el("span", { class: "card-file", title: row.file_name }, [section.bench ? caseName(row.file_name) : row.file_name]), el("span", { class: "marks" }, marks),
    el("span", { class: "card-said" }, [said])]);
  drawLater(picture, () => withView(row.view, (view) => picture.replaceChildren(thumbnail(section, view)),
    () => picture.append(el("span", { class: "no-thumb" }, ["left behind"]))));
  return made;
}

const THUMBS = new Map();
const A_FRAME = 6;
let drawing = false;

/* Some in each frame, the newest first: a filter answers before its pictures are there. */
function drawLater(picture, draw) {
  THUMBS.set(picture, draw);
  if (drawing) { return; }
  drawing = true;
  requestAnimationFrame(drawSome);
}

/* All of them at once: paper has no next frame. */
export function drawAll() { THUMBS.forEach((draw, picture) => { THUMBS.delete(picture); draw(); }); }

function drawSome() {
  Array.from(THUMBS.entries()).reverse().filter(([picture]) => picture.isConnected).slice(0, A_FRAME)
    .forEach(([picture, draw]) => { THUMBS.delete(picture); draw(); });
  THUMBS.forEach((_, picture) => { if (!picture.isConnected) { THUMBS.delete(picture); } });
  drawing = THUMBS.size > 0;
  if (drawing) { requestAnimationFrame(drawSome); }
}

const AT_CONFIDENCE = { key: "", counts: [] };

/* A photo's counts of what is confident enough. */
export function atConfidence(section, row, k, cell) {
  const conf = confidenceOf(section);
  if (!conf || !cell.sure) { return cell; }
  if (conf === section.cohorts.usual) { return { ...cell, tp: cell.sure[0], fp: cell.sure[1], fn: cell.tp + cell.fn - cell.sure[0] }; }
  const key = section.key + " " + conf;
  if (AT_CONFIDENCE.key !== key) {
    Object.assign(AT_CONFIDENCE, { key, counts: section.sides.map((_, side) => countsOf(section, side, { conf })),
      places: new Map(section.cohorts.images.map(([id], i) => [id, i])) });
  }
  const [{ tp, fp, n }, i] = [AT_CONFIDENCE.counts[k], AT_CONFIDENCE.places.get(row.id)];
  return { ...cell, tp: tp[i], fp: fp[i], fn: n[i] - tp[i] };
}

function markOf(cell, label) {
  const parts = label ? [el("span", { class: "mark-side" }, [label])] : [];
  if (cell.status !== "ok") { return el("span", { class: "mark" }, [...parts, el("b", { class: "flag" }, [cell.status])]); }
  if (cell.valid !== undefined) {
    parts.push(el("b", { title: "S" }, [fixed(cell.S, 2)]), ...cell.valid ? ["R", "A"].map((name) =>
      el("span", { class: "mark-n" }, [name + " " + fixed(cell[name], 2)])) : [el("b", { class: "flag" }, ["not valid"])]);
  } else if (cell.accuracy !== undefined) {
    parts.push(el("b", {}, [fixed(cell.accuracy, 2)]), " accuracy");
  } else if (cell.counts) {
    parts.push(el("b", {}, [fixed(cell.quality, 2)]), " " + cell.metric);
  } else if (cell.quality === undefined) {
    parts.push(el("b", {}, [fixed(cell.score)]), " " + cell.metric);
  } else {
    parts.push(el("b", { title: "quality" }, [fixed(cell.quality, 2)]),
      count("tp", cell.tp), count("fp", cell.fp), count("fn", cell.fn));
  }
  return el("span", { class: "mark" }, parts);
}

function count(layer, n) {
  const words = { tp: "true positives", fp: "false positives", fn: "missed" }[layer];
  return el("span", { class: "mark-n m-" + layer }, [n + " " + layer.toUpperCase(),
    el("span", { class: "unseen" }, [" (" + words + ")"])]);
}

function thumbnail(section, view) {
  const [w, h] = view.size_wh;
  const url = pictureUrl("photo", view.photo);
  const at = section.bench ? view.sides[0].hit_picture : view.maps ? view.maps.answers[0] : null;
  const over = pictureUrl("overlay", at);
  const error = depthErrorUrl(view.depth);
  const ground = url ? svg("image", { href: url, width: w, height: h, preserveAspectRatio: "none", class: over ? "faded" : null })
    : svg("rect", { class: "no-photo", width: w, height: h });
  const items = view.truths ? drawnItems(view, section.names, leastOf(section)).filter((i) => i.side === 0) : [];
  const shapes = inDrawingOrder(items).filter((i) => i.layer !== "other" && areaOf(i) > 0).map((item) =>
    svg("path", { class: "thumb-line s-" + item.layer, d: shapePath(item.shape, view.size_wh) }));
  return svg("svg", { viewBox: "0 0 " + w + " " + h, "aria-hidden": "true" }, [ground,
    over ? svg("image", { href: over, width: w, height: h, preserveAspectRatio: "none" }) : null,
    error ? svg("svg", { x: url ? w / 2 : 0, width: w, height: h, viewBox: [url ? w / 2 : 0, 0, w, h].join(" ") }, [
      svg("image", { href: error, width: w, height: h, preserveAspectRatio: "none", class: "pixels" })]) : null, ...shapes]);
}

/* The gallery of a section: cards placed by hand in a box as high as all of them. */
export function gallery(section, place) {
  const box = sectionElement(section.key).querySelector("[data-gallery]");
  if (!box) { return; }
  const rows = listed(section, place);
  const key = section.key + " " + confidenceOf(section, place);
  const same = LISTED.drawn === key && LISTED.rows.length === rows.length &&
    rows.every((row, i) => row === LISTED.rows[i]);
  if (!same || !box.childElementCount) {
    LISTED.key = section.key;
    LISTED.drawn = key;
    LISTED.rows = rows;
    box.replaceChildren();
  }
  const count = sectionElement(section.key).querySelector("[data-count=photos]");
  count.textContent = rows.length + " of " + section.images.length + (section.bench ? " cases" : " photos");
  layout();
  const lines = sectionElement(section.key).querySelector("[data-cohort]");
  if (!lines || !section.cohorts || lines.dataset.of === location.hash) { return; }
  lines.dataset.of = location.hash;
  setTimeout(() => { if (lines.dataset.of === location.hash) { lines.replaceChildren(...cohortLines(section, rows, place)); } });
}

function geometry(box) {
  const width = box.clientWidth;
  const columns = Math.max(Math.floor((width + GAP) / (CARD_WIDTH + GAP)), Math.min(2, LISTED.rows.length || 1));
  const wide = (width - GAP * (columns - 1)) / columns;
  return { columns, wide, high: Math.round(wide * 0.72) + CAPTION + MARK * Math.min(sectionOf(LISTED.key).sides.length, MOST_MARKS) };
}

/* Adds the cards that came near the window and takes away those that left it. */
export function layout() {
  const box = LISTED.key && sectionElement(LISTED.key).querySelector("[data-gallery]");
  if (!box || !box.clientWidth) { return; }
  const { columns, wide, high } = geometry(box);
  const lines = Math.ceil(LISTED.rows.length / columns);
  box.style.height = lines * (high + GAP) + "px";
  const top = -box.getBoundingClientRect().top;
  const from = Math.max(0, Math.floor((top - BEYOND) / (high + GAP))) * columns;
  const to = Math.min(LISTED.rows.length, Math.ceil((top + window.innerHeight + BEYOND) / (high + GAP)) * columns);
  const held = new Map();
  Array.from(box.children).forEach((/** @type {any} */ node) => {
    const at = Number(node.dataset.at);
    if ((at < from || at >= to) && !node.contains(document.activeElement)) { node.remove(); } else { held.set(at, node); }
  });
  const section = sectionOf(LISTED.key);
  for (let at = from; at < to; at += 1) {
    const node = held.get(at) || el("div", { role: "listitem", "data-at": at,
      "aria-setsize": LISTED.rows.length, "aria-posinset": at + 1 }, [card(section, LISTED.rows[at], {})]);
    Object.assign(node.style, { left: (at % columns) * (wide + GAP) + "px", width: wide + "px",
      top: Math.floor(at / columns) * (high + GAP) + "px", height: high + "px" });
    if (!held.has(at)) { insert(box, node, at); }
  }
}

/* In the order of the list, so that the Tab key walks it. */
function insert(box, node, at) {
  const next = Array.from(box.children).find((/** @type {any} */ other) => Number(other.dataset.at) > at);
  box.insertBefore(node, next || null);
}

/* Arrow keys among the cards; true where one was. */
export function galleryKey(event) {
  const node = event.target.closest && event.target.closest("[data-gallery] [data-at]");
  if (!node) { return false; }
  const box = node.parentElement;
  const { columns, high } = geometry(box);
  const moves = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns,
    Home: -LISTED.rows.length, End: LISTED.rows.length };
  if (!(event.key in moves)) { return false; }
  const last = LISTED.rows.length - 1;
  let at = Number(node.dataset.at) + moves[event.key];
  if (event.key === "Home" || event.key === "End") { at = Math.min(Math.max(at, 0), last); }
  if (at >= 0 && at <= last) { focusCard(box, at, columns, high); }
  return true;
}

function focusCard(box, at, columns, high) {
  const top = box.getBoundingClientRect().top + Math.floor(at / columns) * (high + GAP);
  if (top < 60 || top + high > window.innerHeight) {
    window.scrollBy({ top: top - window.innerHeight / 3, behavior: "instant" });
    layout();
  }
  const node = Array.from(box.children).find((/** @type {any} */ child) => Number(child.dataset.at) === at);
  if (node) { node.querySelector("a").focus({ preventScroll: true }); }
}

/* The card of the photo that was open gets the focus back. */
export function focusPhoto(section, image) {
  const at = LISTED.rows.findIndex((row) => String(row.id) === image);
  const box = sectionElement(section.key).querySelector("[data-gallery]");
  if (at >= 0 && box && box.clientWidth) {
    const { columns, high } = geometry(box);
    focusCard(box, at, columns, high);
    return;
  }
  const other = sectionElement(section.key).querySelector("[data-sheet] [data-image='" + Number(image) + "']");
  if (other) { other.focus(); }
}

/* A comparison calls a side "scene (mine)": only what differs is kept. */
function shortName(label) { return label.replace(/^\w+ \((.+)\)$/, "$1"); }

/* Tier and view come last in a case's name, where a narrow card would cut them off. */
function caseName(file) { return file.replace(/\.[a-z]+$/, "").replaceAll("__", " ").replace(/view_0*(?=\d)/, "view "); }

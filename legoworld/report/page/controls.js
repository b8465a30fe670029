/* What sorts and filters: the gallery's choices and the table of categories. */

import { el, markScrollers } from "./elements.js";
import { confidenceOf, confidenceSlider } from "./cohorts.js";
import { gallery, orders } from "./gallery.js";
import { here, moveTo } from "./place.js";
import { DATA, sectionElement } from "./views.js";

function rowsOf(tableElement) { return tableElement ? Array.from(tableElement.tBodies[0].rows) : []; }

function valueOf(row, key) {
  const cell = Array.from(row.cells).find((c) => c.dataset.key === key);
  return cell ? cell.dataset.v : "";
}

/* order: "key" rising, "-key" falling, "" as written. Empty values stay at the end. */
function sortTable(tableElement, order) {
  if (tableElement.dataset.order === order) { return; }
  tableElement.dataset.order = order;
  const rows = rowsOf(tableElement);
  rows.forEach((row, i) => { if (!row.dataset.place) { row.dataset.place = String(i); } });
  const falling = order[0] === "-";
  const key = falling ? order.slice(1) : order;
  const values = new Map(rows.map((row) => [row, key ? valueOf(row, key) : ""]));
  const numeric = rows.every((row) => !Number.isNaN(Number(values.get(row))));
  rows.sort((a, b) => {
    const [x, y] = [values.get(a), values.get(b)];
    if ((x === "") !== (y === "")) { return x === "" ? 1 : -1; }
    const by = numeric ? Number(x) - Number(y) : x < y ? -1 : x > y ? 1 : 0;
    return (falling ? -by : by) || Number(a.dataset.place) - Number(b.dataset.place);
  });
  tableElement.tBodies[0].append(...rows);
  tableElement.querySelectorAll("thead button").forEach((button) => {
    if (key && button.dataset.sort === key) {
      button.parentElement.setAttribute("aria-sort", falling ? "descending" : "ascending");
    } else {
      button.parentElement.removeAttribute("aria-sort");
    }
  });
}

function filterRows(tableElement, keeps) {
  let n = 0;
  const rows = rowsOf(tableElement);
  rows.forEach((row) => {
    const kept = keeps(row);
    if (row.hidden === kept) { row.hidden = !kept; }
    n += Number(kept);
  });
  return n + " of " + rows.length;
}

export function applyLists(section, place) {
  const root = sectionElement(section.key);
  const categories = root.querySelector("[data-table=categories]");
  if (categories) {
    sortTable(categories, place.csort);
    const name = place.cq.toLowerCase();
    const shown = filterRows(categories, (row) => row.dataset.text.includes(name));
    root.querySelector("[data-count=categories]").textContent = shown;
  }
  root.querySelectorAll("[data-filter]").forEach((input) => {
    const wanted = place[keyOf(input)];
    if (input.value !== wanted && (document.activeElement !== input || input.tagName === "SELECT")) { input.value = wanted; }
  });
  root.querySelectorAll("[data-confidence]").forEach((host) => {
    if (!section.cohorts || !section.cohorts.sides.some((s) => s.ranked) || host.dataset.conf === String(confidenceOf(section, place))) { return; }
    const focused = host.contains(document.activeElement);
    host.dataset.conf = String(confidenceOf(section, place));
    host.replaceChildren(confidenceSlider(section));
    if (focused) { host.querySelector("input").focus(); }
  });
  if (place.tab === "photos" && !place.image) { gallery(section, place); }
}

function keyOf(input) { return input.dataset.filter === "categories" ? "cq" : input.dataset.filter; }

/** @param {PageSection} section */
function fillChoices(section) {
  const root = sectionElement(section.key);
  const choice = (name, options) => {
    const select = root.querySelector("[data-filter=" + name + "]");
    if (select) { options.forEach(([value, text]) => select.append(el("option", { value }, [text]))); }
  };
  const statuses = new Set(section.images.flatMap((row) => row.cells.map((c) => c.status)));
  choice("status", Array.from(statuses).sort().map((s) => [s, s]));
  choice("kind", DATA.kinds.map((k) => [k, k]));
  choice("cat", Object.keys(section.names).sort((a, b) => section.names[a] < section.names[b] ? -1 : 1)
    .map((id) => [id, section.names[id]]));
  if (section.bench) {
    const tiers = section.images.map((/** @type {any} */ row) => row.tier).filter(Boolean);
    choice("tier", ["easy", "medium", "hard"].filter((t) => tiers.includes(t)).map((t) => [t, t]));
    const flags = new Set(section.images.flatMap((row) => row.cells.flatMap((/** @type {any} */ c) => c.flags)));
    choice("flag", Array.from(flags).sort().map((f) => [f, f.replaceAll("_", " ")]));
  }
  choice("tag", section.tags.map(([tag, ids]) => [tag, tag + " (" + ids.length + ")"]));
  choice("size", (section.cohorts ? section.cohorts.areas.slice(1) : []).map((a) => [a, a]));
  choice("wins", [...section.sides.map((s, k) => [String(k), s.label]), ["tie", "neither"]]);
  choice("sort", orders(section).map(([name, title]) => [name, title]));
}

export function startControls() {
  DATA.sections.forEach((section) => { if (section.sides.length) { fillChoices(section); } });
  document.querySelectorAll("[data-filter]").forEach((input) => {
    input.addEventListener("input", () => moveTo({ [keyOf(input)]: input.value, of: "" }));
  });
  document.querySelectorAll("thead button[data-sort]").forEach((button) => {
    button.addEventListener("click", () => {
      const now = here().csort;
      const key = button.dataset.sort;
      moveTo({ csort: now === key ? "-" + now : now === "-" + key ? "" : key });
    });
  });
  document.addEventListener("toggle", (event) => markScrollers(event.target), true);
}

/* The worst photo of a section, as large as the first screen has room: what it is, what the scene
   made of it, and the scene itself. */

import { el } from "./elements.js";
import { scoreLine } from "./findings.js";
import { atConfidence } from "./gallery.js";
import { linkItems } from "./links.js";
import { panesOf, shownItems } from "./stage.js";
import { withView } from "./views.js";

/* The panes of a family's first screen, those that are there, a fifth where one is not; the next
   worst photos fill what is left. */
/** @type {[string, string[]][]} */
const OF_FAMILY = [
  ["bench", ["reference", "render0", "hits0", "points0"]],
  ["depth", ["photo", "aligned0", "error0", "scene0", "truth"]],
  ["normals", ["photo", "normals0", "error0", "scene0", "truth"]],
  ["maps", ["photo", "truth", "answer0", "agree0"]],
  ["", ["side0", "side1", "render0", "scene0"]],
];
const [ROOM, MOST_PANES] = [3, 4];

/* The worst photo is one with an answer: how many have none is said elsewhere. */
function worstFirst(section) {
  const answered = section.images.filter((row) => row.cells[0].status === "ok");
  return answered.length ? answered : section.images;
}

/** @param {PageSection} section
 * @param {boolean} printed without the scene in 3D, which is drawn later
 * @returns {() => void} what ends the scenes in 3D */
export function worst(section, host, printed) {
  const rows = worstFirst(section);
  const grid = el("div", { class: "panes" });
  const many = section.sides.length > 1;
  const opened = [];
  const add = (at, room) => withView(rows[at].view, (view) => {
    const [row, address] = [rows[at], "#/" + section.key + "/" + view.id];
    const [part, items] = [el("div", { class: "part" }), shownItems(section, view)];
    const { choices, frames } = panesOf(section, view, items, linkItems(part, items, () => {}));
    const wanted = OF_FAMILY.find(([name]) => !name || view[name] || (name === "bench" && section.bench))[1]
      .filter((key) => choices.some((c) => c.key === key && !c.why && !(printed && c.close)));
    const shown = choices.filter((c) => wanted.slice(0, MOST_PANES).includes(c.key)).slice(0, at ? room : MOST_PANES);
    if (at === 0) {
      host.prepend(el("p", { class: "worst-head" }, [el("b", {}, ["Worst " + (section.bench ? "case" : "photo") +
        (rows.length < section.images.length ? " with an answer: " : ": "),
        el("a", { href: address }, [row.file_name])]), ...row.cells.map((cell, k) =>
        scoreLine(atConfidence(section, row, k, cell), row.n_truth, many ? section.sides[k].label : "")),
      row.cells[0].advice ? el("span", { class: "sub" }, [row.cells[0].advice]) : null]));
    }
    part.append(...shown.map((choice) => el("figure", { class: "pane" }, [
      el("figcaption", {}, [at ? el("a", { href: address }, [row.file_name]) : choice.title]), choice.make()])));
    grid.append(part);
    opened.push(...shown.filter((choice) => choice.close));
    grid.dataset.n = String(Math.max(shown.length, ROOM));
    frames.resized();
    if (shown.length < room && at + 1 < rows.length) { add(at + 1, room - shown.length); }
  }, () => {});
  host.append(grid);
  add(0, ROOM);
  return () => opened.forEach((choice) => choice.close());
}

/* One photo: its panes with one zoom, what is wrong, what to do, and what the run recorded. */

import { benchChecks, benchObjects } from "./bench.js";
import { button, el, markScrollers } from "./elements.js";
import { findingsOf, objectsOf, recordOf, scoreLine } from "./findings.js";
import { frameKey } from "./frames.js";
import { atConfidence, neighbours, step } from "./gallery.js";
import { linkItems } from "./links.js";
import { describe } from "./outcomes.js";
import { here, moveTo, noteInAddress } from "./place.js";
import { drawFirst, questionList } from "./relations.js";
import { shownItems, stageOf } from "./stage.js";
import { DATA, leftBehind, sectionOf, withView } from "./views.js";

/* What keys act on while a photo is open. */
let OPEN = null;

export function leaveDetail() {
  if (OPEN) { OPEN.close(); }
  OPEN = null;
}

export function showDetail(section, place) {
  const panel = document.getElementById("detail");
  const focused = document.activeElement instanceof HTMLElement && panel.contains(document.activeElement)
    ? document.activeElement.dataset.keep : "";
  const at = DATA.views.findIndex((v) => v[0] === section.key && String(v[1]) === place.image);
  leaveDetail();
  if (at < 0) {
    panel.replaceChildren(el("p", { class: "note" }, ["No photo " + place.image + " in " + section.key + "."]));
    return;
  }
  withView(at, (view) => {
    if (here().image !== String(view.id)) { return; }
    const made = detailOf(section, view, place);
    const others = otherTasks(at);
    OPEN = { ...made, close: () => [made, ...others.open].forEach((one) => one.close()),
      ready: () => [made, ...others.open].forEach((one) => one.ready()) };
    panel.replaceChildren(topBar(view), view.said ? el("p", { class: "note" }, [view.said]) : "", made.root, ...others.nodes);
    const target = panel.querySelector("[data-keep='" + (focused || "title") + "']");
    if (target) { target.focus({ preventScroll: true }); }
    OPEN.ready();
  }, () => {
    panel.replaceChildren(el("p", { class: "note" }, ["Its picture and shapes are not here: " + leftBehind()]));
  });
}

/* What other tasks say of the same photo, each built when it is first unfolded. */
function otherTasks(at) {
  const open = [];
  const others = DATA.views.map((v, i) => ({ section: sectionOf(v[0]), i, photo: v[2] }))
    .filter((o) => o.i !== at && o.photo === DATA.views[at][2] && o.section.key !== DATA.views[at][0]);
  const nodes = others.map(({ section, i }) => {
    const body = el("div", {}, []);
    const row = section.images.find((r) => r.id === DATA.views[i][1]);
    const many = section.sides.length > 1;
    const scores = row ? row.cells.map((c, k) => scoreLine(c, row.n_truth, many ? section.sides[k].label : "").textContent) : [];
    const node = el("details", { class: "other-task", "data-other": section.key }, [el("summary", {}, [
      section.title, el("span", { class: "over" }, [scores.join("; ")]),
      el("a", { href: "#/" + section.key + "/" + DATA.views[i][1] }, ["alone"])]), body]);
    node.addEventListener("toggle", () => {
      if (!node.open || body.firstChild) { return; }
      withView(i, (view) => {
        const made = detailOf(section, view, { section: section.key, image: String(view.id) }, true);
        open.push(made);
        body.replaceChildren(made.root);
        made.ready();
      }, () => { body.replaceChildren(el("p", { class: "note" }, ["Its picture and shapes are not here: " + leftBehind()])); });
    });
    return node;
  });
  return { open, nodes: nodes.length ? [el("h2", { class: "other-tasks" }, ["The same photo in other tasks"]), ...nodes] : [] };
}

/**
 * A photo's panes, scores, findings and objects.
 * @returns {any}
 */
function detailOf(section, view, place, beside = false) {
  const row = section.images.find((r) => r.id === view.id);
  const many = view.sides.length > 1;
  const root = el("div", { class: "photo" });
  const items = shownItems(section, view);
  const picked = el("p", { class: "picked", "aria-live": "polite" }, [HINT]);
  const links = linkItems(root, items, (lit, pinned) => {
    picked.textContent = lit.length ? lit.slice(0, 3).map(describe).join("; ") +
      (lit.length > 3 ? " and " + (lit.length - 3) + " more" : "") : HINT;
    picked.classList.toggle("pinned", pinned);
  });
  const stage = stageOf(section, view, items, links, place, beside ? () => {} : noteInAddress);
  root.addEventListener("click", (event) => pickFrom(event, items, links, stage));
  const scores = row ? row.cells.map((c, k) => scoreLine(atConfidence(section, row, k, c), row.n_truth, many ? view.sides[k].label : "")) : [];
  const findings = view.sides.flatMap((s, k) => findingsOf(s, k, items, many, section.sides[k]));
  if (!section.bench && section.sides.every((s) => s.scene)) {
    findings.push(el("p", { class: "sub" }, ["no specialist was run"]));
  }
  const objects = view.sides.flatMap((s, k) => {
    const list = section.bench ? benchObjects(view, items, k) : view.truths ? objectsOf(view, items, k) : [];
    const title = many ? s.label + ": " + (section.bench ? "scored objects" : "objects") : section.bench ? "Scored objects" : "Objects";
    return [list.length ? el("h3", {}, [title]) : null, ...list, section.bench ? benchChecks(s) : null];
  });
  root.append(el("div", { class: "look" }, [stage.node, picked]),
    el("div", { class: "scores" }, scores), el("div", { class: "said" }, findings),
    el("div", { class: "lists" + (section.bench || view.questions ? " wide" : "") }, [view.questions ? questionList(view, root) : null, ...objects, ...view.sides.map((s) =>
      recordOf(s, section.bench ? "numbers, cameras, hashes" : "camera, sizes, hashes"))]));
  return { root, links, frames: stage.frames, close: stage.close, ready: () => { stage.frames.resized(); markScrollers(root); drawFirst(root); } };
}

const HINT = "Point at an outline, a row or a finding; click or press Enter to keep it. Ctrl + wheel, " +
  "double-click, + and - zoom all panes; drag to pan; 0 fits.";

function pickFrom(event, items, links, stage) {
  const node = event.target.closest("[data-items]");
  if (!node || node.closest("svg")) { return; }
  const ids = node.dataset.items.split(" ").map(Number);
  const pinned = links.pin(ids);
  if (!pinned.size) { return; }
  stage.frames.show(items[ids[0]].shape.box);
  const box = stage.node.getBoundingClientRect();
  if (box.bottom < 80 || box.top > window.innerHeight - 80) { stage.node.scrollIntoView({ block: "start" }); }
}

function topBar(view) {
  if (DATA.alone) {
    return el("div", { class: "bar-top" }, [el("h2", { tabindex: -1, "data-keep": "title" }, [view.file_name]),
      el("span", { class: "count" }, [sectionOf(view.section).title])]);
  }
  const around = neighbours();
  const where = around.at < 0 ? "outside the list's filters" : (around.at + 1) + " of " + around.n;
  const photos = here().tab === "photos";
  return el("div", { class: "bar-top" }, [
    button("\u2190 " + (photos ? "all photos" : "overview"), () => moveTo({ image: "" }), { "data-keep": "up" }),
    el("h2", { tabindex: -1, "data-keep": "title" }, [view.file_name]),
    el("span", { class: "count" }, [(view.objects ? "case " : "image ") + view.id + ", " + where]),
    DATA.trajectories ? el("a", { href: DATA.trajectories + "#" + encodeURIComponent(DATA.views.find((v) =>
      v[0] === view.section && v[1] === view.id)[2]) }, ["how it was made"]) : null,
    button("\u2039 previous", () => step(-1), { "data-keep": "previous" }),
    button("next \u203a", () => step(1), { "data-keep": "next" })]);
}

/* True where the key was for the photo. */
export function detailKey(event) {
  const inFrame = event.target.closest && event.target.closest("svg.frame");
  if (inFrame && frameKey(OPEN.frames, event.key)) { return true; }
  if (event.target.closest && event.target.closest("canvas")) { return false; }
  if (event.key === "ArrowLeft") { step(-1); return true; }
  if (event.key === "ArrowRight") { step(1); return true; }
  if (event.key === "Escape") {
    if (!OPEN || !OPEN.links.release()) { moveTo({ image: "" }); }
    return true;
  }
  return OPEN ? frameKey(OPEN.frames, event.key) : false;
}

window.addEventListener("resize", () => { if (OPEN) { OPEN.ready(); } });

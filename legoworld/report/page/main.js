/* Start, and what a changed address, a key or a click does. */

import { applyLists, startControls } from "./controls.js";
import { detailKey, leaveDetail, showDetail } from "./detail.js";
import { markScrollers } from "./elements.js";
import { drawAll, focusPhoto, galleryKey, layout } from "./gallery.js";
import { overview } from "./overview.js";
import { KEYS, here, moveTo, noteInAddress, parsePlace } from "./place.js";
import { plots } from "./plots.js";
import { DATA, sectionElement } from "./views.js";

const TABS = ["overview", "photos", "plots", "numbers", "repeat"];
const LAST = { image: "", section: "", tab: "", scroll: 0 };

function show() {
  const place = here();
  const section = DATA.sections.find((s) => s.key === place.section) || DATA.sections[0];
  const strange = place.section && place.section !== section.key ? place.section : "";
  const said = document.getElementById("strange");
  said.hidden = !strange;
  said.textContent = strange && "There is no section " + strange + " on this page: this is " + section.title + ".";
  if (strange) { place.image = ""; noteInAddress({ section: section.key, image: "" }); }
  place.section = section.key;
  if (DATA.alone && !place.image) {
    place.image = String(section.images[0].id);
    noteInAddress({ section: section.key, image: place.image });
  }
  place.tab = TABS.includes(place.tab) ? place.tab : "overview";
  const opened = place.image && !LAST.image;
  if (opened) { LAST.scroll = window.scrollY; }
  document.querySelectorAll("section.task").forEach((s) => { s.hidden = s.dataset.section !== section.key; });
  document.querySelectorAll("[data-panel]").forEach((p) => { p.hidden = p.dataset.panel !== place.tab; });
  markHere("[data-section-link]", (a) => a.dataset.sectionLink === section.key);
  markHere("[data-tab-link]", (a) => a.dataset.tabLink === place.tab);
  document.querySelectorAll("[data-tab-link]").forEach((a) => { a.href = tabAddress(section, a.dataset.tabLink); });
  document.getElementById("pages").hidden = Boolean(place.image);
  document.getElementById("detail").hidden = !place.image;
  document.body.classList.toggle("one", Boolean(place.image));
  applyLists(section, place);
  if (place.tab === "overview" && !place.image) { overview(section); }
  if (place.tab === "plots") { plots(section); }
  if (place.image) {
    showDetail(section, place);
    if (opened) { window.scrollTo(0, 0); }
  } else {
    leaveDetail();
    if (LAST.image) {
      window.scrollTo(0, LAST.scroll);
      layout();
      focusPhoto(section, LAST.image);
    } else if (LAST.section !== section.key || LAST.tab !== place.tab) {
      if (LAST.section) { window.scrollTo(0, 0); }
      layout();
    }
    markScrollers(sectionElement(section.key));
  }
  Object.assign(LAST, { image: place.image, section: section.key, tab: place.tab });
}

function tabAddress(section, tab) { return "#/" + section.key + (tab === "overview" ? "" : "?tab=" + tab); }

function markHere(selector, isHere) {
  document.querySelectorAll(selector).forEach((a) => {
    if (isHere(a)) { a.setAttribute("aria-current", "page"); } else { a.removeAttribute("aria-current"); }
  });
}

/* A link into the page keeps what it does not name where it leads to a photo, and drops the filters
   where it names its own. */
function follow(event) {
  const link = event.target.closest("a[href^='#/']");
  if (!link || event.metaKey || event.ctrlKey || event.shiftKey) { return; }
  event.preventDefault();
  const wanted = parsePlace(link.getAttribute("href"));
  if (wanted.image) { moveTo({ section: wanted.section, image: wanted.image }); return; }
  const changes = { section: wanted.section, image: "", tab: wanted.tab };
  if (wanted.section !== here().section || wanted.kind || wanted.cat || wanted.status || wanted.tier || wanted.flag || wanted.tag) {
    KEYS.forEach((key) => { changes[key] = wanted[key]; });
  }
  moveTo(changes);
}

function onKey(event) {
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (typing || event.metaKey || event.ctrlKey || event.altKey) { return; }
  const done = here().image ? detailKey(event) : galleryKey(event);
  if (done) { event.preventDefault(); }
}

function start() {
  document.querySelectorAll(".unscripted").forEach((note) => note.remove());
  startControls();
  document.addEventListener("click", follow);
  document.addEventListener("keydown", onKey);
  window.addEventListener("legoworld-moved", show);
  window.addEventListener("popstate", show);
  let waiting = false;
  const again = () => {
    if (waiting) { return; }
    waiting = true;
    requestAnimationFrame(() => { waiting = false; layout(); });
  };
  window.addEventListener("scroll", again, { passive: true });
  window.addEventListener("resize", () => { again(); document.querySelectorAll("section.task:not([hidden])").forEach(markScrollers); });
  window.addEventListener("beforeprint", () => {
    if (document.getElementById("figure-alone")) { return; }
    if (!DATA.alone) { DATA.sections.forEach((s) => { overview(s, true); plots(s); }); }
    drawAll();
  });
  show();
}

start();

/* Start, and what a changed address, a key or a click does. */

var DATA = JSON.parse(document.getElementById("data").textContent);
var LAST = { image: "", scroll: 0 };

function show() {
  var place = parsePlace(location.hash);
  var section = DATA.sections.find(function (s) { return s.key === place.section; }) || DATA.sections[0];
  place.section = section.key;
  if (place.image && !LAST.image) { LAST.scroll = window.scrollY; }
  document.querySelectorAll("section.task").forEach(function (s) {
    s.hidden = s.dataset.section !== section.key;
  });
  document.querySelectorAll("nav a").forEach(function (a) {
    if (a.dataset.tab === section.key) { a.setAttribute("aria-current", "page"); }
    else { a.removeAttribute("aria-current"); }
  });
  applyLists(section, place);
  document.getElementById("overview").hidden = Boolean(place.image);
  document.getElementById("detail").hidden = !place.image;
  document.body.classList.toggle("one", Boolean(place.image));
  if (place.image) {
    showDetail(section, place);
    if (LAST.image !== place.image && !LAST.image) { window.scrollTo(0, 0); }
  } else if (LAST.image) {
    window.scrollTo(0, LAST.scroll);
    markRow(section, LAST.image);
  }
  LAST.image = place.image;
}

/* The row of the photo that was open. */
function markRow(section, image) {
  document.querySelectorAll("tr.here").forEach(function (r) { r.classList.remove("here"); });
  rowsOf(sectionElement(section.key).querySelector("[data-table=photos]")).forEach(function (r) {
    r.classList.toggle("here", r.dataset.image === image);
  });
}

/* A link to a kind or a category filters the list, and goes to it. */
function followFilter(event) {
  var link = event.target.closest("a[href^='#/']");
  if (!link || event.metaKey || event.ctrlKey || event.shiftKey) { return; }
  event.preventDefault();
  var wanted = parsePlace(link.getAttribute("href"));
  var now = parsePlace(location.hash);
  if (wanted.image) { moveTo({ section: wanted.section, image: wanted.image }); return; }
  var changes = { section: wanted.section, image: "" };
  if (wanted.section !== now.section) {
    KEYS.forEach(function (key) { changes[key] = wanted[key]; });
  }
  if (wanted.kind) { changes.kind = wanted.kind; changes.cat = ""; }
  if (wanted.cat) { changes.cat = wanted.cat; changes.kind = ""; }
  moveTo(changes);
  if (wanted.kind || wanted.cat) {
    sectionElement(wanted.section).querySelector("[data-count=photos]").scrollIntoView({ block: "center" });
  }
}

function onKey(event) {
  var typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (typing || event.metaKey || event.ctrlKey || event.altKey || !parsePlace(location.hash).image) { return; }
  if (event.key === "ArrowLeft") { event.preventDefault(); step(-1); }
  if (event.key === "ArrowRight") { event.preventDefault(); step(1); }
  if (event.key === "Escape") { moveTo({ image: "" }); }
}

function start() {
  DATA.sections.forEach(function (section) { if (section.sides.length) { fillChoices(section); } });
  document.querySelectorAll("[data-filter]").forEach(function (input) {
    var key = input.dataset.filter === "categories" ? "cq" : input.dataset.filter;
    input.addEventListener("input", function () {
      var change = {};
      change[key] = input.value;
      moveTo(change);
    });
  });
  document.querySelectorAll("thead button[data-sort]").forEach(function (button) {
    button.addEventListener("click", function () {
      var key = button.closest("table").dataset.table === "photos" ? "sort" : "csort";
      var now = parsePlace(location.hash)[key];
      var change = {};
      change[key] = now === button.dataset.sort ? "-" + now : now === "-" + button.dataset.sort ? "" : button.dataset.sort;
      moveTo(change);
    });
  });
  document.addEventListener("click", followFilter);
  document.addEventListener("keydown", onKey);
  window.addEventListener("hashchange", show);
  window.addEventListener("popstate", show);
  show();
}

start();

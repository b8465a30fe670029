/* Tables that sort and filter. A row knows its values; the page holds every row from the start. */

function sectionElement(key) {
  return Array.from(document.querySelectorAll("section.task")).find(function (s) {
    return s.dataset.section === key;
  });
}

/* A comparison without its evaluations has no list of photos. */
function rowsOf(tableElement) { return tableElement ? Array.from(tableElement.tBodies[0].rows) : []; }

function valueOf(row, key) {
  var cell = Array.from(row.cells).find(function (c) { return c.dataset.key === key; });
  return cell ? cell.dataset.v : "";
}

/* order: "key" rising, "-key" falling, "" as written. Empty values stay at the end. */
function sortTable(tableElement, order) {
  if (tableElement.dataset.order === order) { return; }
  tableElement.dataset.order = order;
  var body = tableElement.tBodies[0];
  var rows = rowsOf(tableElement);
  rows.forEach(function (row, i) { if (!row.dataset.place) { row.dataset.place = i; } });
  var falling = order[0] === "-";
  var key = falling ? order.slice(1) : order;
  var values = new Map(rows.map(function (row) { return [row, key ? valueOf(row, key) : ""]; }));
  var numeric = rows.every(function (row) { return !Number.isNaN(Number(values.get(row))); });
  rows.sort(function (a, b) {
    var x = values.get(a);
    var y = values.get(b);
    if ((x === "") !== (y === "")) { return x === "" ? 1 : -1; }
    var by = numeric ? Number(x) - Number(y) : x < y ? -1 : x > y ? 1 : 0;
    return (falling ? -by : by) || a.dataset.place - b.dataset.place;
  });
  body.append.apply(body, rows);
  tableElement.querySelectorAll("thead button").forEach(function (button) {
    if (key && button.dataset.sort === key) {
      button.parentElement.setAttribute("aria-sort", falling ? "descending" : "ascending");
    } else {
      button.parentElement.removeAttribute("aria-sort");
    }
  });
}

function filterRows(tableElement, keeps) {
  var n = 0;
  var rows = rowsOf(tableElement);
  rows.forEach(function (row) {
    var kept = keeps(row);
    if (row.hidden === kept) { row.hidden = !kept; }
    n += kept;
  });
  return n + " of " + rows.length;
}

function applyLists(section, place) {
  var root = sectionElement(section.key);
  var photos = root.querySelector("[data-table=photos]");
  var categories = root.querySelector("[data-table=categories]");
  if (photos) {
    sortTable(photos, place.sort);
    var q = place.q.toLowerCase();
    var text = filterRows(photos, function (row) {
      var d = row.dataset;
      return d.text.includes(q) && holds(d.status, place.status) && holds(d.kinds, place.kind) &&
        holds(d.cats, place.cat);
    });
    root.querySelector("[data-count=photos]").textContent = text + " photos";
  }
  if (categories) {
    sortTable(categories, place.csort);
    var name = place.cq.toLowerCase();
    var shown = filterRows(categories, function (row) { return row.dataset.text.includes(name); });
    root.querySelector("[data-count=categories]").textContent = shown;
  }
  root.querySelectorAll("[data-filter]").forEach(function (input) {
    var wanted = place[input.dataset.filter === "categories" ? "cq" : input.dataset.filter];
    if (input.value !== wanted && document.activeElement !== input) { input.value = wanted; }
  });
}

function holds(words, wanted) { return !wanted || words.split(" ").includes(wanted); }

/* The photos as listed now, and where the open one is among them. */
function neighbours() {
  var place = parsePlace(location.hash);
  var root = sectionElement(place.section);
  var rows = rowsOf(root.querySelector("[data-table=photos]")).filter(function (r) { return !r.hidden; });
  var ids = rows.map(function (r) { return r.dataset.image; });
  return { ids: ids, n: ids.length, at: ids.indexOf(place.image) };
}

function step(by) {
  var around = neighbours();
  var next = around.at < 0 ? (by > 0 ? 0 : around.n - 1) : around.at + by;
  if (next >= 0 && next < around.n) { moveTo({ image: around.ids[next] }); }
}

function fillChoices(section) {
  var root = sectionElement(section.key);
  var status = root.querySelector("[data-filter=status]");
  var cat = root.querySelector("[data-filter=cat]");
  var seen = new Set();
  root.querySelectorAll("[data-table=photos] tbody tr").forEach(function (row) {
    row.dataset.status.split(" ").forEach(function (s) { if (s) { seen.add(s); } });
  });
  if (status) { Array.from(seen).sort().forEach(function (s) { status.append(el("option", {}, [s])); }); }
  if (cat) {
    Object.keys(section.names).sort(function (a, b) {
      return section.names[a] < section.names[b] ? -1 : 1;
    }).forEach(function (id) { cat.append(el("option", { value: id }, [section.names[id]])); });
  }
}

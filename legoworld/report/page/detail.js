/* One photo: the drawing, what is wrong, what to do, and what the run recorded. */

var MOST_FINDINGS = 12;

function showDetail(section, place) {
  var panel = document.getElementById("detail");
  var at = DATA.views.findIndex(function (v) {
    return v[0] === section.key && String(v[1]) === place.image;
  });
  if (at < 0) {
    panel.replaceChildren(el("p", { class: "note" }, ["No photo " + place.image + " in " +
      section.key + "."]));
    return;
  }
  withView(at, function (view) {
    if (parsePlace(location.hash).image === String(view.id)) {
      panel.replaceChildren.apply(panel, detailOf(section, view, place));
    }
  }, function () {
    panel.replaceChildren(el("p", { class: "note" }, ["Its picture and shapes are not here: keep " +
      "the folder " + DATA.beside + " beside this page."]));
  });
}

function detailOf(section, view, place) {
  var photo = photoOf(view);
  var parts = [topBar(view)];
  if (view.said) { parts.push(el("p", { class: "note" }, [view.said])); }
  var side = el("div", {}, [].concat.apply([], view.sides.map(function (s, k) {
    return adviceOf(s, view.sides.length > 1, section.sides[k]);
  })).concat(section.sides.some(function (s) { return !s.scene; }) ? []
    : [el("p", { class: "sub" }, ["specialist: no specialist was run"])]));
  if (view.depth) {
    parts.push(depthPanes(view, photo), side);
  } else if (view.truths) {
    var items = drawnShapes(view, section.names);
    side.className = "advised";
    parts.push(el("div", { class: "photo" }, [pictureOf(view, photo, place, items), side,
      objectsOf(view, items)]));
  } else {
    if (photo) { parts.push(el("img", { src: photo, alt: view.file_name, width: "60%" })); }
    parts.push(side);
  }
  return parts.concat(view.sides.map(recordOf));
}

function topBar(view) {
  var around = neighbours();
  var where = around.at < 0 ? "outside the list's filters" : (around.at + 1) + " of " + around.n;
  return el("div", { class: "bar-top" }, [
    el("button", { type: "button", onclick: function () { moveTo({ image: "" }); } }, ["\u2191 all photos"]),
    el("button", { type: "button", onclick: function () { step(-1); }, "aria-label": "previous photo" }, ["\u2190"]),
    el("button", { type: "button", onclick: function () { step(1); }, "aria-label": "next photo" }, ["\u2192"]),
    el("h2", {}, [view.file_name]),
    el("span", { class: "count" }, ["image " + view.id + ", " + where]),
  ]);
}

function pictureOf(view, photo, place, items) {
  var shown = new Set(place.show ? place.show.split(".") : defaultLayers());
  var stage = el("div", { class: "stage" });
  function draw() { stage.replaceChildren(stageOf(view, photo, items, shown)); }
  function toggle(key, on) {
    if (on) { shown.add(key); } else { shown.delete(key); }
    var chosen = layerKeys(view).filter(function (k) { return shown.has(k); });
    var usual = chosen.join(".") === defaultLayers().join(".");
    history.replaceState(null, "", formatPlace(Object.assign(parsePlace(location.hash),
      { show: usual ? "" : chosen.join(".") || "none" })));
    draw();
  }
  draw();
  return el("div", {}, [stage, layersOf(view, items, shown, toggle)]);
}

function layersOf(view, items, shown, toggle) {
  function box(key, text, mark) {
    var input = el("input", { type: "checkbox", "data-layer": key,
      onchange: function (event) { toggle(key, event.target.checked); } });
    input.checked = shown.has(key);
    return el("label", {}, [input, " ", mark ? el("span", { class: "key " + mark }) : null, text]);
  }
  var general = [box("photo", "photo"), box("names", "names"),
    box("truth", "truth (" + view.truths.length + ")", "truth")];
  var fields = [el("fieldset", {}, [el("legend", {}, ["show"])].concat(spaced(general)))];
  view.sides.forEach(function (side, k) {
    var boxes = ["tp", "fp", "fn", "other"].map(function (layer) {
      var n = items.filter(function (i) { return keyOf(i) === layer + k; }).length;
      return layer === "other" && !n ? null : box(layer + k, WORDS[layer] + " (" + n + ")", layer);
    });
    var dash = ["solid", "dashed", "dash-dotted"][Math.min(k, 2)];
    var name = side.label + (view.sides.length > 1 ? " (" + dash + ")" : "");
    fields.push(el("fieldset", {}, [el("legend", {}, [name])].concat(spaced(boxes))));
  });
  return el("div", { class: "layers" }, fields);
}

function spaced(boxes) {
  return [].concat.apply([], boxes.map(function (b) { return [b, " "]; }));
}

/* The same as text; pointing at a row shows which shape it is. */
function objectsOf(view, items) {
  var many = view.sides.length > 1;
  var rows = items.filter(function (item) { return item.layer !== "truth"; }).map(function (item) {
    var cells = [item.name, (many ? view.sides[item.side].label + ": " : "") + item.what,
      item.iou === null ? "-" : item.iou.toFixed(3),
      item.score === undefined ? "-" : Number(item.score.toFixed(3))];
    function hot(on) { if (item.node) { item.node.classList.toggle("hot", on); } }
    return el("tr", { onmouseenter: function () { hot(true); }, onmouseleave: function () { hot(false); } },
      cells.map(function (text) { return el("td", {}, [String(text)]); }));
  });
  var head = ["category", "what became of it", "IoU", "score"].map(function (text) {
    return el("th", { scope: "col" }, [text]);
  });
  var made = el("table", { class: "objects" }, [el("thead", {}, [el("tr", {}, head)]),
    el("tbody", {}, rows)]);
  return el("details", { open: "" }, [el("summary", {}, [rows.length + " objects"]),
    el("div", { class: "scroll" }, [made])]);
}

function adviceOf(side, many, about) {
  var good = side.advice.every(function (a) { return a.level === "note"; });
  var title = about.scene ? "What to do next" : "Findings";
  var verdict = el("span", { class: "verdict v-" + (side.status === "ok" ? "ok" : "bad") }, [side.status]);
  var list = side.advice.map(function (a) {
    return el("li", { class: "a-" + a.level }, [a.what, a.do ? el("span", { class: "do" }, [a.do]) : null]);
  });
  var rest = list.splice(MOST_FINDINGS);
  if (good) { list.unshift(el("li", {}, ["nothing to complain about"])); }
  return [el("h3", {}, [many ? side.label + ": " + title.toLowerCase() : title, ", verdict ", verdict]),
    el("ul", { class: "advice" }, list),
    rest.length ? el("details", {}, [el("summary", {}, [rest.length + " more"]),
      el("ul", { class: "advice" }, rest)]) : ""];
}

function recordOf(side) {
  var pairs = [];
  side.facts.forEach(function (f) { pairs.push(el("dt", {}, [f[0]]), el("dd", {}, [f[1]])); });
  var parts = side.tables.map(function (t) {
    return el("div", {}, [el("h3", {}, [t.title]), table(t.head, t.rows)]);
  });
  return el("div", {}, parts.concat([el("details", {}, [
    el("summary", {}, [side.label + ": camera, sizes, hashes"]), el("dl", { class: "facts" }, pairs)])]));
}

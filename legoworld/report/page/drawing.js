/* Truth and predictions over a photo. A colour says what became of it, a dash pattern whose it is. */

var WORDS = { tp: "found", fp: "false", fn: "unfound", other: "not counted", truth: "truth" };

function layerOf(outcome) { return outcome === "tp" || outcome === "fp" ? outcome : "other"; }

/* Everything that is drawn: {layer, side, what, shape, name, text}. */
function drawnShapes(view, names) {
  var shapes = view.truths.map(function (truth, t) {
    var ignored = view.sides.length && view.sides[0].truth[t] === "ignored";
    return { layer: "truth", side: -1, shape: truth, name: names[truth.c], t: t,
      what: ignored ? "truth, not counted (crowd or ignored)" : "truth", iou: null };
  });
  view.sides.forEach(function (side, k) {
    view.truths.forEach(function (truth, t) {
      var state = side.truth[t];
      if (state !== "missed" && state !== "reached") { return; }
      shapes.push({ layer: "fn", side: k, shape: truth, name: names[truth.c], t: t, iou: null,
        what: state === "missed" ? "missed" : "unfound, but an error below reaches it" });
    });
    side.predictions.forEach(function (p) {
      shapes.push({ layer: layerOf(p.o), side: k, shape: p, name: names[p.c], t: p.t, iou: p.i,
        score: p.s, what: whatOf(p, view, names) });
    });
  });
  return shapes;
}

function whatOf(p, view, names) {
  if (p.o === "tp") { return "found"; }
  if (p.o === "ignored") { return "not counted (on an ignored truth)"; }
  if (p.o === "unverified") { return "not counted (nobody checked this category here)"; }
  if (p.o === "over_cap") { return "not counted (beyond the evaluator's cap)"; }
  return "false: " + p.k + (p.t === null ? "" : " (" + names[view.truths[p.t].c] + ")");
}

function layerKeys(view) {
  var keys = ["photo", "names", "truth"];
  view.sides.forEach(function (side, k) {
    ["tp", "fp", "fn", "other"].forEach(function (layer) { keys.push(layer + k); });
  });
  return keys;
}

function defaultLayers() { return ["photo", "names", "truth", "tp0", "fp0", "fn0"]; }

function keyOf(item) { return item.layer === "truth" ? "truth" : item.layer + item.side; }

function stageOf(view, photo, items, shown) {
  var w = view.size_wh[0];
  var h = view.size_wh[1];
  var size = Math.max(w, h);
  var ground = photo && shown.has("photo")
    ? svg("image", { href: photo, width: w, height: h, preserveAspectRatio: "none" })
    : svg("rect", { width: w, height: h, fill: photo ? "#444" : "#555" });
  var root = svg("svg", { viewBox: "0 0 " + w + " " + h, role: "img",
    "aria-label": "truth and predictions over " + view.file_name }, [ground]);
  if (!photo) {
    var lines = svg("text", { class: "missing-photo", x: w / 2, y: h / 2, "text-anchor": "middle",
      "font-size": size * 0.03 }, ["no photo"]);
    root.append(lines);
  }
  var tags = svg("g", {});
  var order = ["truth", "other", "tp", "fn", "fp"];
  items.slice().sort(function (a, b) {
    return order.indexOf(a.layer) - order.indexOf(b.layer) || areaOf(b) - areaOf(a);
  }).forEach(function (item) {
    if (!shown.has(keyOf(item))) { return; }
    var path = shapePath(item.shape, view.size_wh);
    var side = item.side > 0 ? " side-" + Math.min(item.side, 2) : "";
    item.node = svg("g", { class: "s-" + item.layer + side }, [
      svg("path", { class: "shape halo", d: path }),
      svg("path", { class: "shape line", d: path }, [svg("title", {}, [describe(item)])]),
    ]);
    root.append(item.node);
    if (shown.has("names") && item.layer !== "truth") { tags.append(tagOf(item, size, w)); }
  });
  root.append(tags);
  return root;
}

function tagOf(item, size, width) {
  /* Never under 11 pixels of the screen, on a phone, too. */
  var font = size * Math.max(0.021, 11 / Math.min(window.innerWidth, 740));
  var sign = { tp: "", fp: "\u2715 ", fn: "? ", other: "\u00b7 " }[item.layer];
  var text = sign + item.name + (item.iou === null ? "" : " " + item.iou.toFixed(2));
  var right = item.shape.box[0] > width * 0.75;
  return svg("text", { class: "tag", "font-size": font, "stroke-width": font * 0.25,
    x: right ? item.shape.box[0] + item.shape.box[2] - font * 0.3 : item.shape.box[0] + font * 0.3,
    "text-anchor": right ? "end" : "start",
    y: Math.max(item.shape.box[1] + font * (item.layer === "fn" ? 2.3 : 1.15), font) }, [text]);
}

function areaOf(item) { return item.shape.box[2] * item.shape.box[3]; }

function describe(item) {
  return item.name + ": " + item.what + (item.iou === null ? "" : ", IoU " + item.iou.toFixed(3));
}

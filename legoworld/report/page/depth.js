/* Depth panes: truth and predictions on one scale, signed errors on another, one cursor for all. */

/* Viridis (Smith and van der Walt, matplotlib) and ColorBrewer's PuOr: both safe for colour-blind
   eyes. Near is bright; a prediction that is too near is orange, one that is too far purple. */
var NEAR_TO_FAR = [[253, 231, 37], [159, 218, 58], [74, 193, 109], [31, 161, 135], [39, 127, 142],
  [54, 92, 141], [70, 50, 127], [68, 1, 84]];
var NEAR_FAR_ERROR = [[179, 88, 6], [224, 130, 20], [253, 184, 99], [254, 224, 182], [247, 247, 247],
  [216, 218, 235], [178, 171, 210], [128, 115, 172], [84, 39, 136]];
var NONE = [140, 140, 140];

function colorAt(map, share) {
  var at = Math.min(Math.max(share, 0), 1) * (map.length - 1);
  var low = Math.min(Math.floor(at), map.length - 2);
  return map[low].map(function (v, c) { return v + (map[low + 1][c] - v) * (at - low); });
}

/* Float64Array of metres, NaN where there is none. */
function depths(codes, depth) {
  var bytes = atob(codes);
  var z = new Float64Array(bytes.length / 2);
  for (var i = 0; i < z.length; i += 1) {
    var code = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
    z[i] = code === 65535 ? NaN : depth.z0_m * Math.exp(depth.step * code);
  }
  return z;
}

function painted(values, size, color) {
  var canvas = el("canvas", { width: size[0], height: size[1] });
  var context = canvas.getContext("2d");
  var picture = context.createImageData(size[0], size[1]);
  for (var i = 0; i < values.length; i += 1) {
    var rgb = Number.isNaN(values[i]) ? NONE : color(values[i]);
    picture.data.set([rgb[0], rgb[1], rgb[2], 255], 4 * i);
  }
  context.putImageData(picture, 0, 0);
  return canvas;
}

function depthColor(depth) {
  var near = 1 / depth.near_far_z_m[0];
  var far = 1 / depth.near_far_z_m[1];
  return function (z) { return colorAt(NEAR_TO_FAR, (near - 1 / z) / Math.max(near - far, 1e-12)); };
}

function errorColor(depth) {
  var end = Math.max(depth.error_m, 1e-9);
  return function (error) { return colorAt(NEAR_FAR_ERROR, (error / end + 1) / 2); };
}

/* A bar whose colour at a share is color(value(share)), with the values written below. */
function legend(title, value, color, ticks) {
  var canvas = el("canvas", { width: 256, height: 1 });
  var context = canvas.getContext("2d");
  for (var i = 0; i < 256; i += 1) {
    context.fillStyle = "rgb(" + color(value(i / 255)).map(Math.round).join(",") + ")";
    context.fillRect(i, 0, 1, 1);
  }
  var marks = ticks.map(function (share) { return el("span", {}, [metres(value(share))]); });
  return el("div", { class: "legend" }, [title, canvas, el("div", { class: "ticks" }, marks)]);
}

function metres(z) {
  if (Number.isNaN(z)) { return "none"; }
  return (Math.abs(z) < 10 ? z.toFixed(3) : z.toFixed(2)) + " m";
}

function signed(z) { return (z > 0 ? "+" : "") + metres(z); }

function depthPanes(view, photo) {
  var depth = view.depth;
  var size = depth.size_wh;
  var truth = depths(depth.truth, depth);
  var picture = photo ? el("img", { src: photo, alt: view.file_name }) : null;
  var panes = [["photo", picture], ["truth", painted(truth, size, depthColor(depth))]];
  var sides = [];
  view.sides.forEach(function (side, k) {
    if (depth.aligned[k] === null) { return; }
    var aligned = depths(depth.aligned[k], depth);
    var error = aligned.map(function (z, i) { return z - truth[i]; });
    sides.push({ label: side.label, aligned: aligned, error: error });
    panes.push([side.label + ", aligned", painted(aligned, size, depthColor(depth))]);
    panes.push([side.label + " minus truth", painted(error, size, errorColor(depth))]);
  });
  var readout = el("p", { class: "readout", "aria-live": "polite" }, ["Point at a pixel."]);
  var crosses = [];
  var figures = panes.filter(function (p) { return p[1]; }).map(function (p) {
    var cross = el("span", { class: "cross", hidden: "" });
    crosses.push(cross);
    var pane = el("div", { class: "pane" }, [p[1], cross]);
    ["pointermove", "pointerdown"].forEach(function (kind) {
      pane.addEventListener(kind, function (event) {
        var box = pane.getBoundingClientRect();
        point((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
      });
    });
    return el("figure", {}, [el("figcaption", {}, [p[0]]), pane]);
  });
  function point(x, y) {
    var column = Math.min(Math.max(Math.floor(x * size[0]), 0), size[0] - 1);
    var row = Math.min(Math.max(Math.floor(y * size[1]), 0), size[1] - 1);
    var at = row * size[0] + column;
    var near = "near x " + Math.floor((column + 0.5) * depth.image_wh[0] / size[0]) + ", y " +
      Math.floor((row + 0.5) * depth.image_wh[1] / size[1]);
    readout.textContent = near + ": truth " + metres(truth[at]) + sides.map(function (s) {
      var off = s.error[at];
      var share = Number.isNaN(off) ? "" : ", off " + signed(off) + " (" +
        (100 * off / truth[at]).toFixed(1) + " %)";
      return "; " + s.label + " " + metres(s.aligned[at]) + share;
    }).join("");
    crosses.forEach(function (cross) {
      cross.hidden = false;
      cross.style.left = 100 * (column + 0.5) / size[0] + "%";
      cross.style.top = 100 * (row + 0.5) / size[1] + "%";
    });
  }
  return el("div", {}, [readout, el("div", { class: "depth" }, figures)].concat(legends(depth)));
}

function legends(depth) {
  var near = 1 / depth.near_far_z_m[0];
  var far = 1 / depth.near_far_z_m[1];
  var z = function (share) { return 1 / (near - share * (near - far)); };
  var error = function (share) { return (2 * share - 1) * depth.error_m; };
  var none = el("p", { class: "sub" }, [el("span", { class: "swatch" }), " no depth. A pixel of these"
    + " panes is one pixel of the photo, one with measured depth where its block has any; the"
    + " prediction is read at the same pixel."]);
  return [
    legend("depth, aligned: near to far, even in 1/z", z, depthColor(depth), [0, 0.25, 0.5, 0.75, 1]),
    legend("aligned minus truth: too near to too far", error, errorColor(depth), [0, 0.25, 0.5, 0.75, 1]),
    none,
  ];
}

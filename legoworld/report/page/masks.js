/* Masks as outlines along pixel edges. Run lengths are pycocotools' compressed counts: five bits a
   character with a continuation bit, sign-extended, from the fourth number on the difference to the
   last but one; columns from the left, each from the top. */

function runLengths(counts) {
  var runs = [];
  var at = 0;
  while (at < counts.length) {
    var value = 0;
    var shift = 0;
    var code;
    do {
      code = counts.charCodeAt(at) - 48;
      value |= (code & 31) << shift;
      shift += 5;
      at += 1;
    } while (code & 32);
    if (code & 16) { value |= -1 << shift; }
    if (runs.length > 2) { value += runs[runs.length - 2]; }
    runs.push(value);
  }
  return runs;
}

/* The mask with a border of one empty pixel all around: (height + 2) a column. */
function paddedMask(counts, width, height) {
  var tall = height + 2;
  var mask = new Uint8Array((width + 2) * tall);
  var pixel = 0;
  runLengths(counts).forEach(function (run, k) {
    if (k % 2) {
      for (var p = pixel; p < pixel + run; p += 1) {
        mask[(Math.floor(p / height) + 1) * tall + (p % height) + 1] = 1;
      }
    }
    pixel += run;
  });
  return mask;
}

/* Corners of the outline, row by row. Where two pixels touch at a point the corner comes twice. */
function corners(mask, width, height) {
  var tall = height + 2;
  var found = [];
  for (var y = 0; y <= height; y += 1) {
    for (var x = 0; x <= width; x += 1) {
      var at = x * tall + y;
      var a = mask[at];
      var b = mask[at + tall];
      var c = mask[at + 1];
      var d = mask[at + tall + 1];
      if ((a + b + c + d) % 2) {
        found.push([x, y]);
      } else if (a !== b && a === d) {
        found.push([x, y], [x, y]);
      }
    }
  }
  return found;
}

/* In a row, and in a column, the corners are the ends of edges, two by two. */
function partners(points, along) {
  var open = new Map();
  var other = new Int32Array(points.length);
  points.forEach(function (point, i) {
    var line = point[along];
    if (open.has(line)) {
      other[i] = open.get(line);
      other[other[i]] = i;
      open.delete(line);
    } else {
      open.set(line, i);
    }
  });
  return other;
}

/* SVG path data, to be filled by the even-odd rule. */
function maskPath(counts, width, height) {
  var points = corners(paddedMask(counts, width, height), width, height);
  var across = partners(points, 1);
  var down = partners(points, 0);
  var seen = new Uint8Array(points.length);
  var path = "";
  for (var start = 0; start < points.length; start += 1) {
    if (seen[start]) { continue; }
    path += "M" + points[start][0] + " " + points[start][1];
    var i = start;
    do {
      seen[i] = 1;
      i = across[i];
      seen[i] = 1;
      path += "H" + points[i][0];
      i = down[i];
      path += "V" + points[i][1];
    } while (i !== start);
    path += "Z";
  }
  return path;
}

function polygonPath(polygons) {
  return polygons.map(function (p) {
    var path = "";
    for (var i = 0; i < p.length; i += 2) { path += (i ? "L" : "M") + p[i] + " " + p[i + 1]; }
    return path + "Z";
  }).join("");
}

function boxPath(box) {
  return "M" + box[0] + " " + box[1] + "h" + box[2] + "v" + box[3] + "h" + -box[2] + "Z";
}

function shapePath(shape, size) {
  if (shape.rle) { return maskPath(shape.rle, size[0], size[1]); }
  return shape.polygons ? polygonPath(shape.polygons) : boxPath(shape.box);
}

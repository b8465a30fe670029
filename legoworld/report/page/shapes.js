/* Masks as outlines along pixel edges. Run lengths are pycocotools' compressed counts: five bits a
   character with a continuation bit, sign-extended, from the fourth number on the difference to the
   last but one; columns from the left, each from the top. */

function runLengths(counts) {
  const runs = [];
  let at = 0;
  while (at < counts.length) {
    let value = 0;
    let shift = 0;
    let code;
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

/* The mask's runs as [first pixel, length], and the extent they lie in. */
function painted(counts, height) {
  const spans = [];
  let pixel = 0;
  let [left, top, right, bottom] = [Infinity, Infinity, -1, -1];
  runLengths(counts).forEach((run, k) => {
    if (k % 2 && run) {
      const [first, last] = [Math.floor(pixel / height), Math.floor((pixel + run - 1) / height)];
      const whole = first !== last;
      spans.push([pixel, run]);
      left = Math.min(left, first);
      right = Math.max(right, last);
      top = Math.min(top, whole ? 0 : pixel % height);
      bottom = Math.max(bottom, whole ? height - 1 : (pixel + run - 1) % height);
    }
    pixel += run;
  });
  return { spans, left, top, right, bottom };
}

/* The part of the mask that is painted, with a border of one empty pixel: `tall` a column. */
function padded(area, height) {
  const tall = area.bottom - area.top + 3;
  const mask = new Uint8Array((area.right - area.left + 3) * tall);
  area.spans.forEach(([start, run]) => {
    for (let p = start; p < start + run; p += 1) {
      mask[(Math.floor(p / height) - area.left + 1) * tall + (p % height) - area.top + 1] = 1;
    }
  });
  return { mask, tall, wide: mask.length / tall };
}

/* Corners of the outline, row by row. Where two pixels touch at a point the corner comes twice. */
function corners({ mask, tall, wide }) {
  const points = [];
  for (let y = 0; y < tall - 1; y += 1) {
    for (let x = 0; x < wide - 1; x += 1) {
      const at = x * tall + y;
      const [a, b, c, d] = [mask[at], mask[at + tall], mask[at + 1], mask[at + tall + 1]];
      if ((a + b + c + d) % 2) {
        points.push([x, y]);
      } else if (a !== b && a === d) {
        points.push([x, y], [x, y]);
      }
    }
  }
  return points;
}

/* In a row, and in a column, the corners are the ends of edges, two by two. */
function partners(points, along) {
  const open = new Map();
  const other = new Int32Array(points.length);
  points.forEach((point, i) => {
    const line = point[along];
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
export function maskPath(counts, height) {
  const area = painted(counts, height);
  if (area.right < 0) { return ""; }
  const points = corners(padded(area, height));
  const across = partners(points, 1);
  const down = partners(points, 0);
  const seen = new Uint8Array(points.length);
  const parts = [];
  for (let start = 0; start < points.length; start += 1) {
    if (seen[start]) { continue; }
    parts.push("M", points[start][0] + area.left, " ", points[start][1] + area.top);
    let i = start;
    do {
      seen[i] = 1;
      i = across[i];
      seen[i] = 1;
      parts.push("H", points[i][0] + area.left);
      i = down[i];
      parts.push("V", points[i][1] + area.top);
    } while (i !== start);
    parts.push("Z");
  }
  return parts.join("");
}

function polygonPath(polygons) {
  return polygons.map((p) => {
    let path = "";
    for (let i = 0; i < p.length; i += 2) { path += (i ? "L" : "M") + p[i] + " " + p[i + 1]; }
    return path + "Z";
  }).join("");
}

function boxPath(box) {
  return "M" + box[0] + " " + box[1] + "h" + box[2] + "v" + box[3] + "h" + -box[2] + "Z";
}

const PATHS = new WeakMap();

/** @param {DrawnTruth} shape */
export function shapePath(shape, size) {
  if (!PATHS.has(shape)) {
    PATHS.set(shape, shape.rle ? maskPath(shape.rle, size[1])
      : shape.polygons ? polygonPath(shape.polygons) : boxPath(shape.box));
  }
  return PATHS.get(shape);
}

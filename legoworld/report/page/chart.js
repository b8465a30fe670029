/* Plots as SVG: axes, marks, and beside each its table and its files. */

import { button, el, svg, table } from "./elements.js";

/**
 * A plot's frame: scales and axes to draw in.
 * @param {{width?: number, height?: number, left?: number, x: Axis, y: Axis, label: string}} options
 * @typedef {{from: number, to: number, ticks: number[], title: string, log?: boolean, text?: (v: number) => string}} Axis
 */
export function chart(options) {
  const { width = 520, height = 300, left = 52, x, y, label } = options;
  const box = { left, top: 12, right: width - 14, bottom: height - 40 };
  const sx = scale(x, box.left, box.right);
  const sy = scale(y, box.bottom, box.top);
  const marks = svg("g", {});
  const grid = [];
  x.ticks.forEach((v) => grid.push(svg("line", { class: "grid", x1: sx(v), x2: sx(v), y1: box.top, y2: box.bottom }),
    svg("text", { class: "tick", x: sx(v), y: box.bottom + 15, "text-anchor": "middle" }, [textOf(x, v)])));
  y.ticks.forEach((v) => grid.push(svg("line", { class: "grid", x1: box.left, x2: box.right, y1: sy(v), y2: sy(v) }),
    svg("text", { class: "tick", x: box.left - 6, y: sy(v) + 4, "text-anchor": "end" }, [textOf(y, v)])));
  const titles = [
    svg("text", { class: "axis", x: (box.left + box.right) / 2, y: height - 6, "text-anchor": "middle" }, [x.title]),
    svg("text", { class: "axis", x: 0, y: 0, "text-anchor": "middle",
      transform: "translate(12 " + (box.top + box.bottom) / 2 + ") rotate(-90)" }, [y.title])];
  const root = svg("svg", { class: "chart", viewBox: "0 0 " + width + " " + height, role: "img", "aria-label": label },
    [...grid, ...titles, marks]);
  return { root, marks, sx, sy, box };
}

function scale(axis, low, high) {
  const f = axis.log ? Math.log : (v) => v;
  const [from, to] = [f(axis.from), f(axis.to)];
  return (v) => Math.round((low + (f(v) - from) / Math.max(to - from, 1e-12) * (high - low)) * 100) / 100;
}

function textOf(axis, v) { return axis.text ? axis.text(v) : String(Number(v.toPrecision(6))); }

/* Round values from 0 to the first that is not below the largest. */
export function roundTicks(most, parts = 5) {
  const raw = Math.max(most, 1e-9) / parts;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const ticks = [];
  for (let k = 0; k * step < most + step; k += 1) { ticks.push(Number((k * step).toPrecision(12))); }
  return ticks;
}

export function pathOf(points) {
  return points.map((p, i) => (i ? "L" : "M") + p[0] + " " + p[1]).join("");
}

/* A plot with its title, legend, explanation, table and downloads. */
export function plotFigure({ name, title, root, keys, note, head, rows }) {
  const legend = (keys || []).map(([cls, text]) => el("span", { class: "legend-key" }, [
    svg("svg", { viewBox: "0 0 26 12", "aria-hidden": "true", width: 26, height: 12 }, [
      svg("rect", { class: "swatch-box " + cls, x: 1, y: 2, width: 24, height: 8 })]), " " + text]));
  const figure = el("figure", { class: "plot" }, [
    el("figcaption", {}, [el("h3", {}, [title]), fileButtons({ name, title, note, rows: [head, ...rows], root })]),
    legend.length ? el("div", { class: "legend-keys" }, legend) : null,
    root,
    note ? el("p", { class: "sub" }, [note]) : null,
    el("details", {}, [el("summary", {}, ["table, " + rows.length + (rows.length === 1 ? " row" : " rows")]),
      table(head, rows, title)])]);
  if (root) { figure.style.maxWidth = root.viewBox.baseVal.width + "px"; }
  return figure;
}

/* What a table, and the plot of it, can be saved as. rows: the first is the head. */
export function fileButtons({ name, title, note, rows, root }) {
  const one = (kind, ending, type, text) => button(kind, () => save(name + ending, type, text()), { "aria-label": title + " as " + kind });
  return el("span", { class: "files" }, [one("CSV", ".csv", "text/csv", () => csvOf(rows)),
    one("LaTeX", ".tex", "application/x-tex", () => latexOf(rows, title + (note ? ": " + note : ""))),
    ...root ? [one("SVG", ".svg", "image/svg+xml", () => drawingAlone(root).outerHTML),
      button("PDF", () => printAlone(root, name), { "aria-label": title + " as PDF", title: "print this figure alone: choose to save as PDF" })] : []]);
}

const LATEX = { "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}",
  "\u2191": "$\\uparrow$", "\u2193": "$\\downarrow$" };

function latexCell(cell) {
  const text = String(cell ?? "").replace(/\s+/g, " ").replace(/[\\~^&%$#_{}\u2191\u2193]/g, (sign) => LATEX[sign] || "\\" + sign);
  return /^ ?[[*]/.test(text) ? "{}" + text : text;
}

/* A booktabs tabular, as `legoworld compare` writes its own. */
function latexOf([head, ...rows], about) {
  const line = (row) => row.map(latexCell).join(" & ") + " \\\\";
  return ["% needs \\usepackage{booktabs}", "% " + about.replace(/\s+/g, " "), "\\begin{tabular}{" + "l".repeat(head.length) + "}",
    "\\toprule", line(head), "\\midrule", ...rows.map(line), "\\bottomrule", "\\end{tabular}", ""].join("\n");
}

function csvOf(rows) {
  return rows.map((row) => row.map((cell) => {
    const text = cell === null || cell === undefined ? "" : String(cell);
    return /[",\n\r]/.test(text) ? '"' + text.replaceAll('"', '""') + '"' : text;
  }).join(",")).join("\n") + "\n";
}

const KEPT = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-dasharray", "stroke-opacity",
  "font-family", "font-size", "font-weight", "text-anchor", "opacity"];

/* The drawing by itself: every element with the style it has here, on the page's ground, its legend below it. */
function drawingAlone(root) {
  const copy = root.cloneNode(true);
  const [from, to] = [root.querySelectorAll("*"), copy.querySelectorAll("*")];
  from.forEach((node, i) => styled(node, to[i]));
  const { width, height } = root.viewBox.baseVal;
  const keys = legendAlone(root.closest("figure"), width, height);
  const high = height + keys.high;
  copy.removeAttribute("class");
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("viewBox", "0 0 " + width + " " + high);
  copy.setAttribute("width", String(width));
  copy.setAttribute("height", String(high));
  copy.prepend(svg("rect", { width, height: high, fill: getComputedStyle(document.body).backgroundColor }));
  copy.append(...keys.drawn);
  return copy;
}

function styled(node, copy) {
  const style = getComputedStyle(node);
  KEPT.forEach((name) => copy.setAttribute(name, style.getPropertyValue(name)));
  copy.removeAttribute("class");
  return copy;
}

/* A figure's legend, which is HTML in the page, as lines below its drawing; how high they are. */
function legendAlone(figure, width, top) {
  let [x, y] = [0, top + 4];
  const drawn = Array.from(figure.querySelectorAll(".legend-key"), (key) => {
    const wide = key.getBoundingClientRect().width;
    if (x && x + wide > width) { [x, y] = [0, y + 18]; }
    const [swatch, text] = [key.querySelector("rect"), styled(key, svg("text", { x: 30, y: 10 }, [key.textContent.trim()]))];
    text.setAttribute("fill", getComputedStyle(key).color);
    const made = svg("g", { transform: "translate(" + x + " " + y + ")" }, [styled(swatch, swatch.cloneNode()), text]);
    x += wide + 14;
    return made;
  });
  return { drawn, high: drawn.length ? y + 18 - top : 0 };
}

/* The drawing as the only thing on one page of its own size: the browser's print embeds the fonts.
   The ground is paper, whatever the scheme; the browser offers the document's title as file name. */
function printAlone(root, name) {
  const page = document.documentElement;
  const titled = document.title;
  page.classList.add("paper");
  const drawing = drawingAlone(root);
  page.classList.remove("paper");
  const [width, height] = ["width", "height"].map((name) => drawing.getAttribute(name));
  const sheet = el("div", { id: "figure-alone" }, [drawing, el("style", {}, ["@page { size: " + width + "px " + height + "px; margin: 0; }"])]);
  window.addEventListener("afterprint", () => { sheet.remove(); document.title = titled; }, { once: true });
  document.body.append(sheet);
  document.title = name;
  window.print();
}

export function save(name, type, text) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  el("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

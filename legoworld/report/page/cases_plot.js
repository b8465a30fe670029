/* R against A of every case of a bench: geometry and appearance fail apart. */

import { chart, plotFigure } from "./chart.js";
import { fixed, svg } from "./elements.js";

const FIFTHS = [0, 0.2, 0.4, 0.6, 0.8, 1];

/** @param {PageSection} section */
export function casesPlot(section) {
  const made = chart({ label: "R against A of every case", x: { from: 0, to: 1, ticks: FIFTHS, title: "R" },
    y: { from: 0, to: 1, ticks: FIFTHS, title: "A" } });
  const rows = section.images.flatMap((row) => row.cells.map((/** @type {any} */ cell, k) => ({ row, cell, k })));
  rows.filter(({ cell }) => cell.R !== null && cell.A !== null).forEach(({ row, cell, k }) => {
    const [x, y] = [made.sx(cell.R), made.sy(cell.A)];
    const mark = k === 1 ? svg("rect", { class: "point f1", x: x - 4, y: y - 4, width: 8, height: 8 })
      : svg("circle", { class: "point f" + Math.min(k, 2), cx: x, cy: y, r: 4 });
    mark.append(svg("title", {}, [row.file_name + ", " + section.sides[k].label + ": R " + fixed(cell.R) + ", A " + fixed(cell.A)]));
    made.marks.append(mark);
  });
  return plotFigure({ name: "cases-" + section.key, title: "R against A, a mark for each case", root: made.root,
    keys: section.sides.map((s, k) => ["side-key-" + Math.min(k, 2), s.label]),
    head: ["case", "of", "status", "valid", "R", "A", "S"],
    rows: rows.map(({ row, cell, k }) => [row.file_name, section.sides[k].label, cell.status, cell.valid ? 1 : 0,
      fixed(cell.R, 4), fixed(cell.A, 4), fixed(cell.S, 4)]),
    note: "High A with low R is a picture without its geometry; high R with low A is the right geometry in other colours or light." });
}

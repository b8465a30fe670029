/* Questions about a photo: a list, and the one that was chosen drawn between its two things. */

import { el, scroller, svg } from "./elements.js";

/* Boxes of the things a question names, and a line between the first two, in every pane. */
function drawQuestion(root, question) {
  const middles = question.boxes.map((b) => [b[0] + b[2] / 2, b[1] + b[3] / 2]);
  root.querySelectorAll("g.relation").forEach((layer) => {
    const boxes = question.boxes.map((b, i) => svg("rect", { class: "thing thing-" + Math.min(i, 1),
      x: b[0], y: b[1], width: b[2], height: b[3] }));
    const line = middles.length === 2 ? [svg("line", { class: "between", x1: middles[0][0], y1: middles[0][1],
      x2: middles[1][0], y2: middles[1][1] }), svg("circle", { class: "end", cx: middles[1][0], cy: middles[1][1], r: 4 })] : [];
    layer.replaceChildren(svg("title", {}, [question.text]), ...boxes, ...line);
  });
}

function verdict(score) {
  return score === null ? "not scored" : score === 1 ? "right" : score === 0 ? "wrong" : score.toFixed(1);
}

/* Every question with what each side answered, the wrong ones first. */
export function questionList(view, root) {
  const asked = view.questions[0].map((_, i) => view.questions.map((side) => side[i]));
  asked.sort((a, b) => (a[0].score ?? 2) - (b[0].score ?? 2));
  const rows = asked.map((of) => {
    const drawn = of.find((q) => q.boxes.length);
    return el("tr", {}, [
      el("th", { scope: "row" }, [el("button", { type: "button", class: "pick question", disabled: !drawn,
        onclick: (event) => {
          root.querySelectorAll(".pick.question").forEach((b) => b.classList.toggle("pinned", b === event.currentTarget));
          drawQuestion(root, drawn);
        } }, [of[0].text])]),
      el("td", {}, [of[0].truth]),
      ...of.map((q) => el("td", { class: q.score === 0 ? "flag" : null }, [q.answer + " (" + verdict(q.score) + ")"]))]);
  });
  const head = ["question", "ground truth", ...view.sides.map((s) => s.label)];
  return el("div", { class: "questions" }, [el("h3", {}, ["Questions: choose one to see its things"]),
    scroller(el("table", {}, [el("thead", {}, [el("tr", {}, head.map((text) => el("th", { scope: "col" }, [text])))]),
      el("tbody", {}, rows)]), "questions")]);
}

/* The first question whose things are known, drawn once the panes are there. */
export function drawFirst(root) {
  const first = root.querySelector(".pick.question:not([disabled])");
  if (first) { first.click(); }
}

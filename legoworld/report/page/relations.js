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
  const asked = view.questions.map((q, i) => ({ q, i }));
  asked.sort((a, b) => (a.q.scores[0] ?? 2) - (b.q.scores[0] ?? 2) || a.i - b.i);
  const rows = asked.map(({ q }) => el("tr", {}, [
    el("th", { scope: "row" }, [el("button", { type: "button", class: "pick question", disabled: !q.boxes.length,
      onclick: (event) => {
        root.querySelectorAll(".pick.question").forEach((b) => b.classList.toggle("pinned", b === event.currentTarget));
        drawQuestion(root, q);
      } }, [q.text])]),
    el("td", {}, [q.truth]),
    ...q.answers.map((answer, k) => el("td", { class: q.scores[k] === 0 ? "flag" : null }, [answer + " (" + verdict(q.scores[k]) + ")"]))]));
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

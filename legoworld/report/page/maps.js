/* Label maps of a photo: ground truth, each answer, and where their categories agree. */

import { el } from "./elements.js";
import { paneChoices, picture } from "./panes.js";
import { pictureUrl } from "./views.js";

/**
 * What can be shown of a photo.
 * @param {LabelMapPageView} view
 */
export function mapPanes(view, frames) {
  const size = view.size_wh;
  const photo = pictureUrl("photo", view.photo);
  const pane = (key, title, at, usual) => ({ key, title, usual, why: "",
    make: () => frames.frame(title, [picture(pictureUrl("overlay", at), size, { class: "pixels" })]) });
  const rest = paneChoices(view, [], frames).filter((c) => !c.key.startsWith("side"));
  const sides = view.sides.flatMap((side, k) => [
    pane("answer" + k, side.label, view.maps.answers[k], k < 2),
    pane("agree" + k, side.label + ": right and wrong", view.maps.agreements[k], k === 0)]);
  return [{ key: "photo", title: "photo", usual: true, why: photo ? "" : view.said,
    make: () => frames.frame("photo", [picture(photo, size)]) },
    pane("truth", "ground truth", view.maps.truth, true), ...sides,
    ...rest.map((c) => Object.assign(c, { usual: false }))];
}

/* What the colours stand for. */
export function mapLegend() {
  return el("p", { class: "sub" }, ["A category has one hue in all panes, things of one category several shades; " +
    "black is VOID, or no class. Right and wrong: blue where the answer's category is that of the ground truth, red where not, " +
    "black where nothing is scored."]);
}

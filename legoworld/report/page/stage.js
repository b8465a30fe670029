/* The panes of a photo, and the switches that choose among them. */

import { benchItems, benchLegends, benchPanes } from "./bench.js";
import { confidenceOf, confidenceSlider, leastOf } from "./cohorts.js";
import { depthPanes } from "./depth.js";
import { button, el } from "./elements.js";
import { linkedFrames } from "./frames.js";
import { mapLegend, mapPanes } from "./maps.js";
import { normalsPanes } from "./normals.js";
import { drawnItems } from "./outcomes.js";
import { layerSwitches, paneChoices } from "./panes.js";
import { sceneChoices } from "./scene3d.js";

const USUAL_LAYERS = ["truth", "tp", "fp", "fn", "names"];
const LAYER_KEYS = ["truth", "tp", "fp", "fn", "other", "object", "names"];
const OUTLINED = ["truth", "tp", "fp", "fn", "other"];

/* Everything of a photo that can be pointed at. */
export function shownItems(section, view) {
  return section.bench ? benchItems(view, section.names) : view.truths ? drawnItems(view, section.names, leastOf(section)) : [];
}

/**
 * Every pane that a photo can have, in frames of one zoom.
 * @returns {any}
 */
export function panesOf(section, view, items, links) {
  const makePanes = view.depth ? depthPanes : view.normals ? normalsPanes : null;
  const readout = makePanes ? el("p", { class: "readout", "aria-live": "polite" }, ["Point at a pixel."]) : null;
  const frames = linkedFrames(view.size_wh, (x, y, /** @type {any} */ target) => {
    const node = target.closest("[data-items]");
    if (node) { links.pin(node.dataset.items.split(" ").map(Number)); } else { links.release(); }
  }, (x, y) => { if (pixels) { pixels.point(x, y); } });
  const pixels = makePanes ? makePanes(view, frames, readout) : null;
  const panes = pixels ? pixels.choices : view.maps ? mapPanes(view, frames)
    : section.bench ? benchPanes(section, view, items, frames) : paneChoices(view, items, frames);
  const legends = pixels ? pixels.legends : view.maps ? mapLegend() : section.bench ? benchLegends(section.bench) : null;
  return { choices: [...panes, ...sceneChoices(view, items, links)], frames, readout, legends };
}

/**
 * The panes, with their switches.
 * @returns {any}
 */
export function stageOf(section, view, items, links, place, note) {
  const grid = el("div", { class: "panes" });
  const usualLayers = section.bench ? ["object"] : USUAL_LAYERS;
  const shown = new Set(place.show ? place.show.split(".") : usualLayers);
  const { choices, frames, readout, legends } = panesOf(section, view, items, links);
  const one = view.depth || view.normals || view.maps;
  const open = new Map();
  const usual = choices.filter((c) => !c.why && (section.bench ? c.usual && c.key.slice(0, 5) !== "scene" : one ? c.usual !== false : /^(side|slide|scene)/.test(c.key)))
    .map((c) => c.key);
  const wanted = place.panes ? place.panes.split(".") : usual;
  function set(choice, on) {
    if (on && !open.has(choice.key)) {
      const made = choice.make();
      open.set(choice.key, el("figure", { class: "pane" }, [el("figcaption", {}, [choice.title]), made]));
    } else if (!on && open.has(choice.key)) {
      if (choice.close) { choice.close(); }
      open.delete(choice.key);
    }
    grid.replaceChildren(...choices.filter((c) => open.has(c.key)).map((c) => open.get(c.key)));
    grid.dataset.n = String(open.size);
    frames.resized();
    links.redraw();
  }
  const switches = choices.map((choice) => paneSwitch(choice, wanted.includes(choice.key), (on) => {
    set(choice, on);
    const keys = [...choices.filter((c) => open.has(c.key)).map((c) => c.key)];
    note({ panes: keys.join(".") === usual.join(".") ? "" : keys.join(".") });
  }));
  choices.filter((c) => !c.why && wanted.includes(c.key)).forEach((c) => set(c, true));
  const layerKeys = LAYER_KEYS.filter((key) => key === "names" || (key === "object") === Boolean(section.bench));
  const paint = () => layerKeys.forEach((key) => grid.classList.toggle("no-" + key, !shown.has(key)));
  paint();
  const layers = one || view.questions ? [] : [layerSwitches(items, shown, section.bench ? ["object"] : OUTLINED, (key, on) => {
    if (on) { shown.add(key); } else { shown.delete(key); }
    paint();
    const keys = layerKeys.filter((k) => shown.has(k));
    note({ show: keys.join(".") === usualLayers.join(".") ? "" : keys.join(".") || "none" });
  })];
  const zoom = el("div", { class: "zoom", role: "group", "aria-label": "zoom of all panes" }, [
    button("\u2212", () => frames.smaller(), { "aria-label": "smaller" }),
    button("+", () => frames.larger(), { "aria-label": "larger" }), button("fit", () => frames.fit())]);
  const bar = el("div", { class: "stage-bar" }, [el("div", { class: "switch-rows", role: "group", "aria-label": "panes" },
    switchRows(choices, switches)), zoom]);
  if (confidenceOf(section) || place.conf) { layers.push(confidenceSlider(section)); }
  const whys = choices.filter((c) => c.why).map((c) => el("li", {}, [c.title + ": " + c.why]));
  const node = el("div", { class: "stage" }, [bar, readout, grid, ...layers, legends,
    whys.length ? el("details", { class: "whys" }, [
      el("summary", {}, [whys.length === 1 ? "1 pane is not there" : whys.length + " panes are not there"]),
      el("ul", {}, whys)]) : null]);
  return { node, frames, close: () => choices.forEach((c) => { if (c.close && open.has(c.key)) { c.close(); } }) };
}

/* Switches of one submission in a row of their own. */
function switchRows(choices, switches) {
  const groups = Array.from(new Set(choices.map((c) => c.group || "")));
  return groups.map((group) => el("div", { class: "switches" }, [
    group ? el("span", { class: "who" }, [group]) : null, ...switches.filter((_, i) => (choices[i].group || "") === group)]));
}

function paneSwitch(choice, on, change) {
  const made = button(choice.short || choice.title, () => {
    const next = made.getAttribute("aria-pressed") !== "true";
    made.setAttribute("aria-pressed", String(next));
    change(next);
  }, { "aria-pressed": String(on && !choice.why), "data-pane": choice.key, disabled: Boolean(choice.why),
    "aria-label": choice.short ? choice.title : null, title: choice.why || null });
  return made;
}

/* A photo's view, its pictures and its scene: inside the page, or files beside it. */

import { el } from "./elements.js";

/** @type {PageData} */
export const DATA = JSON.parse(document.getElementById("data").textContent);

const VIEWS = new Map();
const SCENES = new Map();
const WAITING = { view: new Map(), scene: new Map() };

/* Called by the scripts beside the page. */
window.legoworldView = (at, view) => arrived("view", VIEWS, at, view);
window.legoworldScene = (at, text) => arrived("scene", SCENES, at, text);

function arrived(kind, known, at, value) {
  known.set(at, value);
  (WAITING[kind].get(at) || []).forEach((waiting) => waiting.use(value));
  WAITING[kind].delete(at);
}

function withFile(kind, known, at, read, use, fail) {
  const inside = document.getElementById(kind + "-" + at);
  if (!known.has(at) && inside) { known.set(at, read(inside.textContent)); }
  if (known.has(at)) { use(known.get(at)); return; }
  const first = !WAITING[kind].has(at);
  if (first) { WAITING[kind].set(at, []); }
  WAITING[kind].get(at).push({ use, fail });
  if (first) {
    document.head.append(el("script", { src: beside(kind, at, "js"), onerror: () => {
      const waiting = WAITING[kind].get(at) || [];
      WAITING[kind].delete(at);
      waiting.forEach((one) => one.fail());
    } }));
  }
}

/** @param {(view: any) => void} use */
export function withView(at, use, fail) { withFile("view", VIEWS, at, JSON.parse, use, fail); }

/* Base64 of a scene.glb. */
export function withScene(at, use, fail) { withFile("scene", SCENES, at, String, use, fail); }

/* What base64 stands for. */
export function bytesOf(text) {
  const signs = atob(text);
  const bytes = new Uint8Array(signs.length);
  for (let i = 0; i < bytes.length; i += 1) { bytes[i] = signs.charCodeAt(i); }
  return bytes;
}

/* The address of a photo or a render, null where there is none. */
export function pictureUrl(kind, at) {
  if (at === null || at === undefined) { return null; }
  const inside = document.getElementById(kind + "-" + at);
  return inside ? "data:image/webp;base64," + inside.textContent : beside(kind, at, "webp");
}

function beside(kind, at, ending) {
  return encodeURIComponent(DATA.beside.folder) + "/" + kind + "-" + String(at).padStart(6, "0") +
    "." + ending;
}

export function leftBehind() { return "keep the folder " + DATA.beside.folder + " beside this page."; }

export function sectionOf(key) { return DATA.sections.find((s) => s.key === key); }

export function sectionElement(key) {
  return Array.from(document.querySelectorAll("section.task")).find((s) => s.dataset.section === key);
}

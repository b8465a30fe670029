/* Where the reader is: everything that can be linked to lives in the address after "#". */

export const KEYS = ["tab", "q", "status", "kind", "cat", "of", "wins", "tier", "flag", "tag", "sort", "size", "conf", "cq", "csort", "show", "panes"];

/** @typedef {{section: string, image: string, [key: string]: string}} Place */

/** @returns {Place} */
export function parsePlace(hash) {
  const text = hash.replace(/^#\/?/, "");
  const cut = text.indexOf("?");
  const path = (cut < 0 ? text : text.slice(0, cut)).split("/");
  const query = new URLSearchParams(cut < 0 ? "" : text.slice(cut + 1));
  /** @type {Place} */
  const place = { section: decodeText(path[0] || ""), image: decodeText(path[1] || "") };
  KEYS.forEach((key) => { place[key] = query.get(key) || ""; });
  return place;
}

function decodeText(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

/** @param {Place} place */
export function formatPlace(place) {
  const query = new URLSearchParams();
  KEYS.forEach((key) => { if (place[key]) { query.set(key, place[key]); } });
  const text = query.toString();
  let path = "#/" + encodeURIComponent(place.section);
  if (place.image) { path += "/" + encodeURIComponent(place.image); }
  return path + (text ? "?" + text : "");
}

export function here() { return parsePlace(location.hash); }

/* Opening or leaving a photo or a tab is a step of the browser's history; a filter is not. */
export function moveTo(changes, section) {
  const place = Object.assign(here(), changes);
  if (!place.section) { place.section = section || ""; }
  const step = ["image", "section", "tab"].some((key) => changes[key] !== undefined);
  const hash = formatPlace(place);
  if (step) { history.pushState(null, "", hash); } else { history.replaceState(null, "", hash); }
  window.dispatchEvent(new Event("legoworld-moved"));
}

/* A change of what is drawn, which nothing but the address has to learn of. */
export function noteInAddress(changes) {
  history.replaceState(null, "", formatPlace(Object.assign(here(), changes)));
}

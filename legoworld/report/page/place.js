/* Where the reader is: everything that can be linked to lives in the address after "#". */

var KEYS = ["q", "status", "kind", "cat", "sort", "cq", "csort", "show"];

function parsePlace(hash) {
  var text = hash.replace(/^#\/?/, "");
  var cut = text.indexOf("?");
  var path = (cut < 0 ? text : text.slice(0, cut)).split("/");
  var query = new URLSearchParams(cut < 0 ? "" : text.slice(cut + 1));
  var place = { section: decodeText(path[0] || ""), image: decodeText(path[1] || "") };
  KEYS.forEach(function (key) { place[key] = query.get(key) || ""; });
  return place;
}

function decodeText(text) {
  try {
    return decodeURIComponent(text);
  } catch (error) {
    return text;
  }
}

function formatPlace(place) {
  var query = new URLSearchParams();
  KEYS.forEach(function (key) { if (place[key]) { query.set(key, place[key]); } });
  var text = query.toString();
  var path = "#/" + encodeURIComponent(place.section);
  if (place.image) { path += "/" + encodeURIComponent(place.image); }
  return path + (text ? "?" + text : "");
}

/* Opening or leaving a photo is a step of the browser's history; a filter is not. */
function moveTo(changes) {
  var place = Object.assign({}, parsePlace(location.hash), changes);
  if (!place.section) { place.section = DATA.sections[0].key; }
  var step = changes.image !== undefined || changes.section !== undefined;
  var hash = formatPlace(place);
  if (step) { history.pushState(null, "", hash); } else { history.replaceState(null, "", hash); }
  show();
}

/* A photo's view: inside the page, or a script beside it. */

var VIEWS = new Map();
var WAITING = new Map();

/* Called by the scripts beside the page. */
window.legoworldView = function (at, view) {
  VIEWS.set(at, view);
  if (WAITING.has(at)) { WAITING.get(at)(view); WAITING.delete(at); }
};

function withView(at, use, fail) {
  var inside = document.getElementById("view-" + at);
  if (VIEWS.has(at)) { use(VIEWS.get(at)); return; }
  if (inside) {
    VIEWS.set(at, JSON.parse(inside.textContent));
    use(VIEWS.get(at));
    return;
  }
  WAITING.set(at, use);
  document.head.append(el("script", { src: beside("view", at, "js"), onerror: fail }));
}

function photoOf(view) {
  if (view.photo === null) { return null; }
  var inside = document.getElementById("photo-" + view.photo);
  return inside ? "data:image/webp;base64," + inside.textContent : beside("photo", view.photo, "webp");
}

function beside(kind, at, ending) {
  return encodeURIComponent(DATA.beside) + "/" + kind + "-" + String(at).padStart(6, "0") + "." + ending;
}

/* Elements by name, attributes and children. Text is always text: names come from strangers. */

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  Object.entries(attributes || {}).forEach(([key, value]) => {
    if (key.slice(0, 2) === "on") {
      element.addEventListener(key.slice(2), value);
    } else if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(key, value === true ? "" : value);
    }
  });
  element.append(...(children || []).flat().filter((c) => c !== null && c !== undefined));
  return element;
}

/**
 * @param {string} name
 * @param {Object<string, any>} [attributes]
 * @param {any[]} [children]
 * @returns {any}
 */
export function el(name, attributes, children) {
  return fill(document.createElement(name), attributes, children);
}

/**
 * @param {string} name
 * @param {Object<string, any>} [attributes]
 * @param {any[]} [children]
 * @returns {any}
 */
export function svg(name, attributes, children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

export function table(head, rows, label) {
  const top = el("tr", {}, head.map((text) => el("th", { scope: "col" }, [text])));
  const body = rows.map((row) => el("tr", {}, row.map((text) => el("td", {}, [String(text)]))));
  return scroller(el("table", {}, [el("thead", {}, [top]), el("tbody", {}, body)]), label);
}

export function scroller(inner, label) {
  return el("div", { class: "scroll", "data-label": label || "table" }, [inner]);
}

/* What scrolls can be scrolled by keys, too: only then is it a stop of the Tab key. */
export function markScrollers(root) {
  root.querySelectorAll(".scroll").forEach((box) => {
    if (box.scrollWidth > box.clientWidth || box.scrollHeight > box.clientHeight) {
      box.setAttribute("tabindex", "0");
      box.setAttribute("role", "group");
      box.setAttribute("aria-label", (box.dataset.label || "table") + ", scrolls");
    } else {
      ["tabindex", "role", "aria-label"].forEach((name) => box.removeAttribute(name));
    }
  });
}

export function button(text, onclick, attributes) {
  return el("button", Object.assign({ type: "button", onclick }, attributes), [text]);
}

export function counted(n, one, many) { return n.toLocaleString("en") + " " + (n === 1 ? one : many); }

export function fixed(value, places = 3) {
  return value === null || value === undefined ? "-" : value.toFixed(places);
}

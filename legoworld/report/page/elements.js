/* Elements by name, attributes and children. Text is always text: names come from strangers. */

var SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  Object.keys(attributes || {}).forEach(function (key) {
    if (key.slice(0, 2) === "on") {
      element.addEventListener(key.slice(2), attributes[key]);
    } else if (attributes[key] !== null && attributes[key] !== undefined) {
      element.setAttribute(key, attributes[key]);
    }
  });
  (children || []).forEach(function (child) {
    if (child !== null && child !== undefined) { element.append(child); }
  });
  return element;
}

function el(name, attributes, children) {
  return fill(document.createElement(name), attributes, children);
}

function svg(name, attributes, children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function table(head, rows) {
  var top = el("tr", {}, head.map(function (text) { return el("th", { scope: "col" }, [text]); }));
  var body = rows.map(function (row) {
    return el("tr", {}, row.map(function (text) { return el("td", {}, [text]); }));
  });
  var made = el("table", {}, [el("thead", {}, [top]), el("tbody", {}, body)]);
  return el("div", { class: "scroll" }, [made]);
}

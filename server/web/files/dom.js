// Makes elements. Whatever comes from the server becomes text nodes and attributes' values, never
// markup: nothing here or elsewhere in these files parses HTML.

import {copyRows} from "./sheet.js";

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined
    && child !== false));
  return element;
}

// An element with attributes ("onclick": a listener) and children: nodes, texts, or lists of them.
export function h(tag, attributes, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

// The same for SVG.
export function s(tag, attributes, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

// A link within these pages. `query` has the parameters of the address; those without a value are
// left out.
export function href(path, query = {}) {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined
    && value !== "");
  return path + (given.length ? `?${new URLSearchParams(given)}` : "");
}

// A table in a box of its own that scrolls sideways where the page is narrow. `label` names it. A head
// is an element or a text; "#" at its end is not shown and means a column of numbers.
export function table(label, heads, rows, attributes = {}) {
  return h("div", {class: "scroll", tabindex: 0, role: "region", "aria-label": label},
    h("table", {...attributes, oncopy: copyRows},
      h("caption", {class: "hidden"}, label),
      h("thead", null, h("tr", null, heads.map((head) => (head instanceof Node ? head
        : h("th", {scope: "col", class: head.endsWith("#") ? "num" : null},
          head.replace(/#$/, "")))))),
      h("tbody", null, rows)));
}

// Names and values under each other.
export function facts(pairs) {
  return h("dl", {class: "facts"}, pairs.filter((pair) => pair).map(([name, value]) =>
    h("div", null, h("dt", null, name), h("dd", null, value))));
}

export function replace(element, ...children) {
  element.replaceChildren(...children.flat(Infinity).filter((child) => child));
}

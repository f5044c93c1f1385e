// The text of a challenge's host, which the API gives as a tree of what may be shown (server/challenge/markdown.h).
import {h} from "./dom.js";
import {visible} from "./format.js";

const TAGS = {paragraph: "p", item: "li", block_quote: "blockquote", emph: "em", strong: "strong"};

function element(node) {
  const inside = () => (node.children ?? []).map(element);
  switch (node.type) {
    case "text": return visible(node.text);
    case "softbreak": return " ";
    case "linebreak": return h("br");
    case "thematic_break": return h("hr");
    case "code": return h("code", null, visible(node.text));
    case "code_block": return h("pre", {tabindex: 0}, visible(node.text));
    // The page has a title already, and its own parts begin at the second level.
    case "heading": return h(`h${Math.min(node.level + 1, 4)}`, null, inside());
    case "list": return node.ordered ? h("ol", {start: node.start === 1 ? null : node.start}, inside())
      : h("ul", null, inside());
    case "link": return h("a", {href: node.url, rel: "noopener noreferrer"}, inside());
    default: return node.type in TAGS ? h(TAGS[node.type], null, inside()) : inside();
  }
}

// Elements of the tree.
export function hostText(tree) {
  return h("div", {class: "host-text"}, tree.map(element));
}

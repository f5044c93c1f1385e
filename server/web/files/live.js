// How fresh a page is, told beside its title.
import {h} from "./dom.js";

// {element, on(words), lost(error)}: that it is current, or that the server can't be reached. Hidden until one of
// them is called; on(null) hides it again.
export function liveBadge() {
  const element = h("span", {class: "live", role: "status", hidden: true});
  const show = (words, title, good) => {
    element.hidden = words === null;
    if (words === null || element.textContent === words) return;
    element.textContent = words;
    element.title = title;
    element.className = good ? "live on" : "live lost";
  };
  return {element,
    on: (words, title = "") => show(words, title, true),
    lost: (error) => show("not connected", `${error.message} It is asked again by itself.`, false)};
}

// What there is in the place of a page that there is not.
import {h, replace} from "./dom.js";

export function show(main) {
  const documents = location.pathname === "/docs" || location.pathname.startsWith("/docs/");
  document.title = "No such page – MyoGrade";
  replace(main, h("h1", null, documents ? "The document is not here" : "There is no such page"),
    h("p", null, documents ? ["This server has no page at this address. If ", h("a", {href: "/docs"}, "/docs"),
      " leads here as well, it was built without the documents: its operator makes them with ",
      h("code", null, "./dev docs"), "."]
      : "Perhaps a letter of the address is wrong, or the page is gone."),
    h("p", null, h("a", {class: "button main", href: "/"}, "To the start")));
}

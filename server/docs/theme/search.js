// Finds parts of pages by their words, in the index that the generator writes. What it shows is text
// nodes: the Content-Security-Policy of the pages lets nothing become markup.
(() => {
  "use strict";

  // On a narrow screen the list of pages is above the page: only its headings, then.
  if (matchMedia("(max-width: 48rem)").matches) {
    document.querySelector(".pages details[open]")?.removeAttribute("open");
  }

  const ROOT = new URL(".", document.currentScript.src);
  const MOST = 20;       // results that are shown
  const AROUND = 90;     // characters of the text before and after the first word that fits
  const IN_TITLE = 20;   // what a word in a title counts, against one in the text
  const ENOUGH = 5;      // further words of a text count no more

  const box = document.querySelector(".search");
  const field = box.querySelector("input");
  const status = box.querySelector("[role=status]");
  const list = box.querySelector("ul");
  const panel = box.querySelector(".found");
  let entries = null;

  function element(tag, text, className) {
    const made = document.createElement(tag);
    if (text) made.textContent = text;
    if (className) made.className = className;
    return made;
  }

  // The index, asked for once and only by those who search. A page has an entry with all of its text, and
  // one for each of its parts, which is what readers look for.
  async function load() {
    const answer = await fetch(new URL("search/search_index.json", ROOT));
    if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
    const {docs} = await answer.json();
    const pages = new Map(docs.map(({location, title}) => [location, title]));
    return docs.filter(({location}) => location.includes("#")).map(({location, title, text}) => ({location,
      title, text, page: pages.get(location.split("#")[0]), lowTitle: title.toLowerCase(),
      lowText: text.toLowerCase()}));
  }

  // Where words begin with `word`.
  function places(text, word) {
    const found = [];
    for (let at = text.indexOf(word); at >= 0 && found.length < ENOUGH; at = text.indexOf(word, at + 1)) {
      if (at === 0 || !/[\p{L}\p{N}]/u.test(text[at - 1])) found.push(at);
    }
    return found;
  }

  // 0 unless every word is there.
  function score(entry, words) {
    let sum = 0;
    for (const word of words) {
      const inTitle = places(entry.lowTitle, word).length > 0;
      const inText = places(entry.lowText, word).length;
      if (!inTitle && !inText) return 0;
      sum += (inTitle ? IN_TITLE : 0) + inText;
    }
    return sum;
  }

  // A piece of the text with the words marked.
  function excerpt(entry, words) {
    const at = Math.min(...words.flatMap((word) => places(entry.lowText, word)));
    // Whole words, so from one space to another.
    const start = at > AROUND && Number.isFinite(at) ? entry.text.indexOf(" ", at - AROUND) + 1 : 0;
    const space = entry.text.indexOf(" ", start + 2 * AROUND);
    const end = space < 0 ? entry.text.length : space;
    const paragraph = element("p");
    let from = start;
    const marks = words.flatMap((word) => places(entry.lowText.slice(start, end), word)
      .map((place) => [start + place, start + place + word.length])).sort((a, b) => a[0] - b[0]);
    paragraph.append(start > 0 ? "… " : "");
    for (const [first, last] of marks) {
      if (first < from) continue;
      paragraph.append(entry.text.slice(from, first), element("mark", entry.text.slice(first, last)));
      from = last;
    }
    paragraph.append(entry.text.slice(from, Math.max(from, end)), end < entry.text.length ? " …" : "");
    return paragraph;
  }

  function show(found, words) {
    list.replaceChildren(...found.slice(0, MOST).map(({entry}) => {
      const item = element("li");
      const link = element("a", entry.title);
      link.href = new URL(entry.location, ROOT);
      item.append(link, entry.page === entry.title ? "" : element("span", entry.page, "page"),
        excerpt(entry, words));
      return item;
    }));
    const more = found.length > MOST ? `, the first ${MOST} of them below` : "";
    status.textContent = found.length === 0 ? "Nothing has all of these words."
      : `${found.length} ${found.length === 1 ? "place" : "places"}${more}`;
  }

  async function search() {
    const words = [...new Set(field.value.toLowerCase().split(/\s+/).filter((word) => word))];
    panel.hidden = words.length === 0;
    if (panel.hidden) return;
    try {
      entries ??= load();
      const all = await entries;
      show(all.map((entry) => ({entry, points: score(entry, words)})).filter(({points}) => points > 0)
        .sort((a, b) => b.points - a.points), words);
    } catch (error) {
      entries = null;
      list.replaceChildren();
      status.textContent = `The index can't be read: ${error.message}.`;
    }
  }

  field.addEventListener("input", search);
  box.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    field.value = "";
    panel.hidden = true;
    field.focus();
  });
  box.hidden = false;
})();

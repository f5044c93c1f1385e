// Finds parts of pages by their words, in the index that the generator writes, and copies examples. What it shows
// is text nodes: the Content-Security-Policy of the pages lets nothing become markup.
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
  // What the parts of the list of pages count, from the first on: most readers take part.
  const AUDIENCES = [2, 1.6, 1.3, 1];
  // Words of questions that say nothing of what is sought.
  const PLAIN = new Set("a an and are can do does for how i in is it my of on or the to what when where which why".split(" "));

  const box = document.querySelector(".search");
  const field = box.querySelector("input");
  const status = box.querySelector("[role=status]");
  const list = box.querySelector("ul");
  const panel = box.querySelector(".found");
  let entries = null;
  let vocabulary = null;  // all words of the index

  // What a page counts, by the part of the list of pages that it is in.
  const weights = new Map([...document.querySelectorAll(".pages details")].flatMap((part, place) =>
    [...part.querySelectorAll("a")].map((link) => [link.pathname, AUDIENCES[place] ?? 1])));

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
    const found = docs.filter(({location}) => location.includes("#")).map(({location, title, text}) => ({location,
      title, text, page: pages.get(location.split("#")[0]), lowTitle: title.toLowerCase(),
      lowText: text.toLowerCase(), weight: weights.get(new URL(location, ROOT).pathname) ?? 1}));
    vocabulary = new Set(found.flatMap((entry) => `${entry.lowTitle} ${entry.lowText}`
      .match(/[\p{L}\p{N}_-]{3,}/gu) ?? []));
    return found;
  }

  // How many letters are wrong, missing, too many or swapped with the next; more than `most` count alike.
  function distance(a, b, most) {
    if (Math.abs(a.length - b.length) > most) return most + 1;
    let before = [];
    let last = Array.from({length: b.length + 1}, (_, place) => place);
    for (let i = 1; i <= a.length; i += 1) {
      const row = [i];
      for (let j = 1; j <= b.length; j += 1) {
        const same = a[i - 1] === b[j - 1];
        row[j] = Math.min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (same ? 0 : 1));
        if (i > 1 && j > 1 && a[i - 1] === b[j - 2] && a[i - 2] === b[j - 1]) row[j] = Math.min(row[j], before[j - 2] + 1);
      }
      [before, last] = [last, row];
    }
    return last[b.length];
  }

  // The word itself if any text has it, else the one that is most like it, or itself if none is.
  function known(word) {
    const most = word.length < 4 ? 0 : word.length < 8 ? 1 : 2;
    let best = {word, wrong: most + 1};
    for (const one of vocabulary) {
      if (one.startsWith(word)) return word;
      const wrong = most ? distance(word, one, best.wrong - 1) : 1;
      if (wrong < best.wrong) best = {word: one, wrong};
    }
    return best.word;
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
    return sum * entry.weight;
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

  function show(found, words, typed) {
    list.replaceChildren(...found.slice(0, MOST).map(({entry}) => {
      const item = element("li");
      const link = element("a", entry.title);
      link.href = new URL(entry.location, ROOT);
      item.append(link, entry.page === entry.title ? "" : element("span", entry.page, "page"),
        excerpt(entry, words));
      return item;
    }));
    const more = found.length > MOST ? `, the first ${MOST} of them below` : "";
    const instead = words.filter((word) => !typed.includes(word));
    const meant = instead.length ? `Shown for “${instead.join(" ")}”: ` : "";
    status.textContent = found.length === 0 ? "Nothing has all of these words."
      : `${meant}${found.length} ${found.length === 1 ? "place" : "places"}${more}`;
  }

  async function search() {
    const written = [...new Set(field.value.toLowerCase().split(/\s+/).filter((word) => word))];
    const telling = written.filter((word) => !PLAIN.has(word.replace(/\?$/, "")));
    const typed = telling.length ? telling : written;
    panel.hidden = typed.length === 0;
    if (panel.hidden) return;
    if (!vocabulary) status.textContent = "Loading the index…";
    try {
      entries ??= load();
      const all = await entries;
      const words = typed.map(known);
      show(all.map((entry) => ({entry, points: score(entry, words)})).filter(({points}) => points > 0)
        .sort((a, b) => b.points - a.points), words, typed);
    } catch (error) {
      entries = null;
      list.replaceChildren();
      status.textContent = `The index can't be read: ${error.message}.`;
    }
  }

  field.addEventListener("input", search);
  box.addEventListener("keydown", (event) => {
    const links = panel.hidden ? [] : [...list.querySelectorAll("a")];
    if (event.key === "Escape") {
      field.value = "";
      panel.hidden = true;
      field.focus();
    } else if (event.key === "Enter" && event.target === field) {
      links[0]?.click();
    } else if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      const at = links.indexOf(document.activeElement) + (event.key === "ArrowDown" ? 1 : -1);
      (at < 0 ? field : links[Math.min(at, links.length - 1)])?.focus();
    }
  });
  box.hidden = false;

  // Without the clipboard, which browsers give to secure origins only, the old way.
  async function copy(pre) {
    try {
      await navigator.clipboard.writeText(pre.textContent.trimEnd());
    } catch {
      getSelection().selectAllChildren(pre);
      if (!document.execCommand("copy")) throw new Error("it is selected: copy it by the keyboard");
      getSelection().removeAllRanges();
    }
  }

  for (const pre of document.querySelectorAll("main pre")) {
    const button = element("button", "Copy");
    button.type = "button";
    button.addEventListener("click", () => copy(pre).then(() => {
      button.textContent = "Copied";
    }, () => {
      button.textContent = "Selected";
    }).finally(() => setTimeout(() => {
      button.textContent = "Copy";
    }, 2000)));
    const around = element("div", null, "snippet");
    pre.replaceWith(around);
    around.append(pre, button);
  }
})();

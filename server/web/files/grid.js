// The episodes of an evaluation as a grid of verdicts.
import {h, replace} from "./dom.js";
import {episodesText, whole} from "./format.js";

const PAGE = 500;
const COLUMNS = 10;
const SIGNS = {success: "✓", failure: "✕", fault: "!", withheld: "·"};

export function kindOf(row) {
  if (row.outcome === null || row.outcome === undefined) return "withheld";
  return row.outcome === "success" || row.outcome === "failure" ? row.outcome : "fault";
}

export function verdict(row) {
  if (kindOf(row) === "withheld") return "withheld";
  return row.reason ? `${row.outcome}: ${row.reason}` : row.outcome;
}

function show(cell, row) {
  const words = `Episode ${row.index}: ${verdict(row)}`;
  if (cell.title === words) return;
  cell.className = `cell ${kindOf(row)}`;
  cell.dataset.index = row.index;
  cell.title = words;
  cell.setAttribute("aria-label", words);
  cell.textContent = SIGNS[kindOf(row)];
}

// Arrow keys go from cell to cell, of which one at a time can be reached by Tab.
function arrows(box, event) {
  const cells = [...box.querySelectorAll(".cell")];
  const place = cells.indexOf(document.activeElement);
  if (place < 0) return;
  const index = (cell) => Number(cell.dataset.index);
  const at = index(cells[place]);
  const below = cells.findIndex((cell) => index(cell) >= at + COLUMNS);
  const above = cells.findLastIndex((cell) => index(cell) <= at - COLUMNS);
  const next = {ArrowRight: place + 1, ArrowLeft: place - 1, ArrowDown: below < 0 ? cells.length - 1 : below,
    ArrowUp: Math.max(above, 0), Home: 0, End: cells.length - 1}[event.key];
  if (next === undefined) return;
  event.preventDefault();
  const cell = cells[Math.min(Math.max(next, 0), cells.length - 1)];
  document.activeElement.tabIndex = -1;
  cell.tabIndex = 0;
  cell.focus();
}

function legend(rows) {
  const kinds = [["success", "success"], ["failure", "failure"], ["fault", "participant's fault"],
    ["withheld", "withheld by the phase"]];
  return kinds.map(([kind, words]) => [kind, words,
    rows.filter((row) => kindOf(row) === kind).length]).filter(([, , count]) => count)
    .map(([kind, words, count]) => h("li", null, h("span", {class: `cell ${kind}`,
      "aria-hidden": "true"}, SIGNS[kind]), ` ${words}: ${whole(count)}`));
}

// The heads of rows of ten, each with the number of its first episode, and where each cell stands.
function arrange(box, cells, page) {
  const base = Math.floor((page[0]?.index ?? 0) / COLUMNS);
  const heads = new Map();
  page.forEach(({index}, at) => {
    const line = Math.floor(index / COLUMNS) - base + 1;
    if (!heads.has(line)) {
      const head = h("span", {class: "row-head", "aria-hidden": "true"}, COLUMNS * (line + base - 1));
      head.style.gridRow = String(line);
      heads.set(line, head);
    }
    Object.assign(cells[at].style, {gridRow: String(line), gridColumn: String(index % COLUMNS + 2)});
  });
  box.querySelectorAll(".row-head").forEach((head) => head.remove());
  box.prepend(...heads.values());
}

// {element, update(rows), choose(index)}. update() may be called again when there are more rows, and changes
// neither the focus nor what is chosen. select(row) is called with the row that is chosen.
export function makeGrid(select) {
  const list = h("ul", {class: "legend"});
  const place = h("span", {role: "status"});
  const box = h("div", {class: "grid", role: "group", "aria-label": "Episodes",
    onkeydown: (event) => arrows(box, event)});
  const cells = [];
  let rows = [];
  let first = 0;
  let chosen = null;
  const choose = (index) => {
    const at = rows.findIndex((row) => row.index === index);
    if (at < 0) return;
    const page = Math.floor(at / PAGE) * PAGE;
    const before = chosen;
    chosen = index;
    if (page !== first) {
      first = page;
      draw();
    }
    for (const cell of cells) {
      const own = Number(cell.dataset.index);
      if (own === before) cell.removeAttribute("aria-pressed");
      if (own === index) cell.setAttribute("aria-pressed", "true");
    }
    select(rows[at]);
  };
  const draw = () => {
    const page = rows.slice(first, first + PAGE);
    while (cells.length > page.length) cells.pop().remove();
    while (cells.length < page.length) {
      cells.push(h("button", {type: "button", tabindex: -1,
        onclick: (event) => choose(Number(event.currentTarget.dataset.index))}));
      box.append(cells.at(-1));
    }
    page.forEach((row, at) => {
      show(cells[at], row);
      if (row.index === chosen) cells[at].setAttribute("aria-pressed", "true");
      else cells[at].removeAttribute("aria-pressed");
    });
    arrange(box, cells, page);
    if (cells.length && !cells.some((cell) => cell.tabIndex === 0)) cells[0].tabIndex = 0;
    if (page.length) place.textContent = episodesText(page[0].index, page.at(-1).index);
  };
  const turn = (by) => {
    first = Math.min(Math.max(first + by, 0), Math.floor((rows.length - 1) / PAGE) * PAGE);
    draw();
  };
  const pager = h("p", {class: "row pager"},
    h("button", {type: "button", onclick: () => turn(-PAGE)}, "Before"), place,
    h("button", {type: "button", onclick: () => turn(PAGE)}, "Next"));
  const update = (all) => {
    rows = all;
    pager.hidden = rows.length <= PAGE;
    replace(list, legend(rows));
    draw();
  };
  return {element: h("div", null, list, pager, box), update, choose};
}

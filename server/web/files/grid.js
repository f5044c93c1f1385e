// The episodes of an evaluation as a grid of verdicts.
import {h, replace} from "./dom.js";
import {whole} from "./format.js";

const PAGE = 500;
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
  const cells = [...box.children];
  const place = cells.indexOf(document.activeElement);
  if (place < 0) return;
  const columns = cells.filter((one) => one.offsetTop === cells[0].offsetTop).length;
  const steps = {ArrowRight: 1, ArrowLeft: -1, ArrowDown: columns, ArrowUp: -columns,
    Home: -place, End: cells.length - 1 - place};
  if (!(event.key in steps)) return;
  event.preventDefault();
  const next = cells[Math.min(Math.max(place + steps[event.key], 0), cells.length - 1)];
  document.activeElement.tabIndex = -1;
  next.tabIndex = 0;
  next.focus();
}

function legend(rows) {
  const kinds = [["success", "success"], ["failure", "failure"], ["fault", "participant's fault"],
    ["withheld", "withheld by the phase"]];
  return kinds.map(([kind, words]) => [kind, words,
    rows.filter((row) => kindOf(row) === kind).length]).filter(([, , count]) => count)
    .map(([kind, words, count]) => h("li", null, h("span", {class: `cell ${kind}`,
      "aria-hidden": "true"}, SIGNS[kind]), ` ${words}: ${whole(count)}`));
}

// {element, update(rows)}. update() may be called again when there are more rows, and changes neither the
// focus nor what is chosen. select(row) is called with the row that is chosen.
export function makeGrid(select) {
  const list = h("ul", {class: "legend"});
  const place = h("span", {role: "status"});
  const box = h("div", {class: "grid", role: "group", "aria-label": "Episodes",
    onkeydown: (event) => arrows(box, event)});
  let rows = [];
  let first = 0;
  let chosen = null;
  const choose = (event) => {
    const row = rows[first + [...box.children].indexOf(event.currentTarget)];
    chosen = row.index;
    draw();
    select(row);
  };
  const draw = () => {
    const page = rows.slice(first, first + PAGE);
    while (box.children.length > page.length) box.lastChild.remove();
    while (box.children.length < page.length) {
      box.append(h("button", {type: "button", tabindex: -1, onclick: choose}));
    }
    page.forEach((row, at) => {
      const cell = box.children[at];
      show(cell, row);
      if (row.index === chosen) cell.setAttribute("aria-pressed", "true");
      else cell.removeAttribute("aria-pressed");
    });
    if (box.firstChild && !box.querySelector("[tabindex='0']")) box.firstChild.tabIndex = 0;
    if (page.length) place.textContent = `Episodes ${page[0].index} to ${page.at(-1).index}`;
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
  return {element: h("div", null, list, pager, box), update};
}

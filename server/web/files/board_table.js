// The table of a board: rows in bands, which can be sorted, filtered and looked into.
import {get} from "./api.js";
import {h, href, replace, table} from "./dom.js";
import {briefly, heading, measure, name, number, percent, visible, whole} from "./format.js";

function probability(value) {
  return value < 0.001 ? "p < 0.001" : `p = ${number(value, 3)}`;
}

// What the paired test says of a row and the one above it.
function testSentence(test, criteria) {
  if (!test || test.metric === null || test.p === null) return null;
  const title = criteria.find((one) => one.name === test.metric)?.title ?? test.metric;
  const verdict = test.decided ? "The episodes decide this place"
    : "The episodes do not decide this place";
  return `${verdict}: paired test of ${title} over ${whole(test.pairs)} episodes, of which `
    + `${whole(test.differing)} differ; ${probability(test.p)}, corrected for all tests `
    + `${probability(test.p_adjusted)}.`
    + (test.reversed ? " With the further episodes the lower one is better." : "");
}

// Fills the cell; whether there was an answer.
async function explain(cell, address, test, criteria) {
  replace(cell, h("p", {role: "status"}, "Loading…"));
  try {
    const answer = await get(address);
    replace(cell, h("p", null, visible(answer.why)), h("p", {class: "quiet"},
      testSentence(test, criteria)));
    return true;
  } catch (error) {
    replace(cell, h("p", {class: "problem"}, visible(error.message)));
    return false;
  }
}

function whyButton(address, above, row, test, criteria, span) {
  const cell = h("td", {colspan: span, class: "why"});
  const more = h("tr", {hidden: true, class: "page-only", id: `why-${row.submission}`}, cell);
  let known = false;
  const button = h("button", {type: "button", class: "small", "aria-expanded": "false",
    "aria-controls": more.id, "aria-label": `Why ${visible(above.team)} stands above `
    + visible(row.team),
    onclick: async () => {
      more.hidden = !more.hidden;
      button.setAttribute("aria-expanded", String(!more.hidden));
      if (!more.hidden && !known) known = await explain(cell, address, test, criteria);
    }}, "Why?");
  return [button, more];
}

function tags(row, mine) {
  return [
    mine && h("span", {class: "tag mine"}, "your team"),
    row.baseline && h("span", {class: "tag"}, "baseline"),
    row.qualified && h("span", {class: "tag good", title: "At or above the board's line"},
      "qualified"),
    row.rejudge && h("span", {class: "tag", title: `Result of rejudge ${row.rejudge}`}, "rejudged"),
    row.other_build && h("span", {class: "tag", title: `Graded by build ${row.build}`},
      "other build"),
  ];
}

function interval(known, metric) {
  if (!known || known.low === null || known.low === undefined) return null;
  const scale = metric ? 1 : 100;
  const digits = metric ? metric.digits : 0;
  return h("span", {class: "interval", title: `95 % interval (${known.method})`},
    `${number(known.low * scale, digits)} to ${number(known.high * scale, digits)}`);
}

function valueCell(row, metric, known, content) {
  const decides = row.decided_by === metric.name;
  return h("td", {class: decides ? "num decides" : "num", "data-label": heading(metric),
    "data-copy": row.aggregate?.[metric.name] ?? "",
    title: decides ? "This decides among the rows around it" : null},
  content, interval(known, metric.name === SUCCESS.name ? null : metric));
}

const SUCCESS = {name: "success_rate", title: "success", unit: "", better: "more"};

function successCell(row, known) {
  const {successes, episodes} = row.aggregate ?? {};
  return valueCell(row, SUCCESS, known, successes === undefined || successes === null ? "–" : [
    h("span", {class: "value"}, percent(successes, episodes)),
    h("meter", {min: 0, max: episodes, value: successes, "aria-label":
      `${successes} of ${episodes} episodes`})]);
}

const COMPARE = {
  rank: (a, b) => a.place - b.place,
  team: (a, b) => a.row.team.localeCompare(b.row.team),
};

// Better values first; rows without one come last.
function compareBy(metric) {
  const sign = metric.better === "less" ? 1 : -1;
  return (a, b) => {
    const [x, y] = [a, b].map((one) => one.row.aggregate?.[metric.name] ?? null);
    if (x === null || y === null) return (x === null) - (y === null);
    return sign * (x - y);
  };
}

// The table of one answer of the API. `board` and `statistics` (null: none yet) are such answers; context:
// {explain(above, below): the address that tells why, mayRead(team), isMine(team), label}.
export class BoardTable {
  constructor(context) {
    this.context = context;
    this.order = "rank";
    this.reverse = false;
    this.wanted = "";
    this.element = h("div");
  }

  show(board, statistics) {
    const known = new Map((statistics?.rows ?? []).map((row) => [row.submission, row]));
    this.metrics = [SUCCESS, ...briefly(board)];
    this.exact = board.columns;
    this.groups = (statistics?.groups ?? []).some((group) => group.rows > 1);
    this.span = board.columns.length + 4 + (this.groups ? 1 : 0);
    this.bands = new Map(board.bands.map((band) => [band.band, band.words]));
    const open = new Set([...this.element.querySelectorAll("tr.page-only:not([hidden])")].map((one) => one.id));
    let above = null;
    this.entries = board.rows.map((row, place) => {
      const entry = this.entryOf(row, place, above, known.get(row.submission), statistics?.criteria ?? []);
      if (!row.baseline || above === null) above = row;
      return entry;
    });
    this.draw();
    // What somebody reads stays open.
    this.entries.forEach((entry) => entry.why && open.has(entry.why.id)
      && entry.element.querySelector(".ask button").click());
  }

  entryOf(row, place, above, more, criteria) {
    const mine = this.context.isMine(row.team);
    const [button, why] = above ? whyButton(this.context.explain(above, row), above, row, more?.above,
      criteria, this.span) : [null, null];
    const submission = row.name ? name(row.name) : `submission ${row.submission}`;
    const element = h("tr", {class: [row.baseline ? "baseline" : "", mine ? "mine" : ""].join(" ").trim()},
      h("td", {class: "num place", "data-label": "Rank"}, row.rank === null ? "–" : row.rank),
      this.groups && h("td", {class: `group ${(more?.group ?? 0) % 2 ? "odd" : "even"}`, "data-label": "Group"},
        more?.group ?? "–"),
      h("th", {scope: "row", "data-copy": visible(row.team)},
        h("a", {href: href("/team", {name: row.team})}, name(row.team)), tags(row, mine),
        h("span", {class: "policy"}, this.context.mayRead(row.team)
          ? h("a", {href: href("/submission", {id: row.submission})}, submission) : submission)),
      successCell(row, more?.intervals?.success_rate),
      this.metrics.slice(1).map((metric, column) => valueCell(row, metric, more?.intervals?.[metric.name],
        h("span", {class: "value", title: measure(row.aggregate?.[metric.name], this.exact[column])},
          number(row.aggregate?.[metric.name], metric.digits)))),
      h("td", {class: "ask page-only"}, button));
    return {row, place, element, why, group: more?.group ?? null,
      words: `${row.team}\n${row.name}`.toLowerCase()};
  }

  // Rows in the order that is wanted. In that of the board, with its bands and groups.
  rows() {
    const metric = this.metrics.find((one) => one.name === this.order);
    const sorted = [...this.entries].sort(COMPARE[this.order] ?? compareBy(metric));
    if (this.reverse) sorted.reverse();
    const shown = sorted.filter((entry) => entry.words.includes(this.wanted));
    let band = null;
    let group = null;
    return shown.flatMap((entry) => {
      const ranked = this.order === "rank" && !this.reverse;
      const opens = ranked && entry.row.band !== null && entry.row.band !== band;
      if (opens) ({band} = entry.row);
      const newGroup = ranked && this.groups && entry.group && group !== null && entry.group !== group;
      if (entry.group) ({group} = entry);
      entry.element.classList.toggle("opens", Boolean(newGroup));
      return [opens && h("tr", {class: "band page-only"}, h("th", {scope: "rowgroup", colspan: this.span},
        visible(this.bands.get(band) ?? ""))), entry.element, entry.why].filter((one) => one);
    });
  }

  sortBy(order) {
    this.reverse = this.order === order && !this.reverse;
    this.order = order;
    this.draw();
    this.element.querySelector(`[data-order="${order}"]`)?.focus();
  }

  head(order, words, classes, title = null) {
    const sorted = this.order === order;
    const direction = this.reverse ? "descending" : "ascending";
    return h("th", {scope: "col", class: classes, "data-copy": words, "aria-sort": sorted ? direction : null}, h("button",
      {type: "button", class: "sort", "data-order": order, title, onclick: () => this.sortBy(order)}, words,
      h("span", {"aria-hidden": "true", class: "way"}, sorted ? (this.reverse ? " ▴" : " ▾") : "")));
  }

  heads() {
    const better = {less: "less is better", more: "more is better", neither: "not ranked"};
    return [this.head("rank", "Rank", "num"),
      this.groups && h("th", {scope: "col", class: "group",
        title: "These episodes don't tell the teams of one group apart"}, "Group"),
      this.head("team", "Team and policy", null),
      ...this.metrics.map((metric) => this.head(metric.name, heading(metric), "num", better[metric.better])),
      h("th", {scope: "col", class: "page-only"}, h("span", {class: "hidden"}, "Why it stands here")),
    ].filter((one) => one);
  }

  draw() {
    const rows = this.rows();
    const box = table(this.context.label, this.heads(), rows, {class: "board"});
    box.classList.add("board-box");
    replace(this.element, box, !rows.length && h("p", {class: "empty"}, "No team or policy has these letters."));
  }

  filter(text) {
    this.wanted = text.trim().toLowerCase();
    this.draw();
  }

  // Shows the row of the reader's team.
  find() {
    this.wanted = "";
    this.draw();
    const row = this.element.querySelector("tr.mine");
    row?.scrollIntoView({block: "center"});
    row?.querySelector("th a")?.focus({preventScroll: true});
  }
}

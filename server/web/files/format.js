// Numbers with units, times, and the texts of participants.
import {h} from "./dom.js";

// Characters that nobody sees, or that turn the text around them: shown by their number. Joiners and
// variation selectors stay, as emoji and several scripts are written with them.
const UNSEEN = /(?![\t\n\u200c\u200d\ufe0e\ufe0f])[\p{Cc}\p{Zl}\p{Zp}\p{Cs}\p{Default_Ignorable_Code_Point}\u200e\u200f\u202a-\u202e\ufff9-\ufffb]/gu;

// A text of several lines, as it is, but for what can't be seen.
export function visible(text) {
  return String(text).replace(UNSEEN, (one) =>
    `⟨U+${one.codePointAt(0).toString(16).toUpperCase().padStart(4, "0")}⟩`);
}

// A name that somebody chose: on one line, and whatever its direction, the text around keeps its own.
export function name(text) {
  return h("bdi", {class: "name"}, visible(String(text).replace(/[\n\t]+/g, " ")));
}

export function number(value, digits = 3) {
  if (value === null || value === undefined) return "–";
  if (!Number.isFinite(value)) return String(value);
  return value.toLocaleString("en", {minimumFractionDigits: digits, maximumFractionDigits: digits});
}

export function whole(value) {
  return value === null || value === undefined ? "–" : value.toLocaleString("en");
}

// A number with its unit; of a metric as the API describes it.
export function measure(value, metric) {
  if (value === null || value === undefined) return "–";
  return number(value, metric.digits) + (metric.unit ? ` ${metric.unit}` : "");
}

// The columns of a board with as many digits as tell its rows apart, and no fewer than three that count.
export function briefly({columns, rows}) {
  return columns.map((metric) => {
    const values = rows.map((row) => row.aggregate?.[metric.name]).filter(Number.isFinite);
    const least = Math.min(...values.filter((value) => value).map(Math.abs));
    const apart = (digits) => new Set(values.map((value) => value.toFixed(digits))).size;
    let digits = Math.min(Math.max(2 - Math.floor(Math.log10(least)), 0), metric.digits);
    while (digits < metric.digits && apart(digits) < apart(metric.digits)) digits += 1;
    return {...metric, digits};
  });
}

export function percent(part, of) {
  if (!of) return "–";
  const value = 100 * part / of;
  return `${number(value, Number.isInteger(value) ? 0 : of > 1000 ? 2 : 1)} %`;
}

// Columns are called by words, with the unit in brackets.
export function heading(metric) {
  const title = metric.title.charAt(0).toUpperCase() + metric.title.slice(1);
  return metric.unit ? `${title} (${metric.unit})` : title;
}

const TITLES = {main: "Main board", physiological: "Physiological board"};

export function boardTitle(board) {
  return TITLES[board] ?? board;
}

export function episodesText(first, last) {
  return first === last ? `Episode ${first}` : `Episodes ${first} to ${last}`;
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  const all = Math.max(Math.round(seconds), 0);
  if (all < 60) return `${all} s`;
  if (all < 3600) return `${Math.floor(all / 60)} min ${all % 60} s`;
  if (all < 86400) return `${Math.floor(all / 3600)} h ${Math.floor(all % 3600 / 60)} min`;
  return `${Math.floor(all / 86400)} d ${Math.floor(all % 86400 / 3600)} h`;
}

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let unit = 0;
  while (count >= 1000 && unit < units.length - 1) {
    count /= 1000;
    unit += 1;
  }
  return `${number(count, unit && count < 10 ? 1 : 0)} ${units[unit]}`;
}

const RELATIVE = new Intl.RelativeTimeFormat("en", {numeric: "auto"});
const STEPS = [["year", 31557600], ["month", 2629800], ["week", 604800], ["day", 86400],
  ["hour", 3600], ["minute", 60]];

function relative(at) {
  const seconds = (at - new Date()) / 1000;
  for (const [unit, length] of STEPS) {
    if (Math.abs(seconds) >= length) return RELATIVE.format(Math.round(seconds / length), unit);
  }
  return RELATIVE.format(Math.round(seconds), "second");
}

const exactly = (text) => `${text.slice(0, 19).replace("T", " ")} UTC`;

// A time of the API, told from now, with the exact one as its title. It stays current.
export function time(text) {
  if (!text) return "–";
  const at = new Date(text);
  return h("time", {datetime: text, title: exactly(text)}, relative(at));
}

const ABSOLUTE = new Intl.DateTimeFormat("en-GB", {day: "numeric", month: "short", year: "numeric",
  hour: "2-digit", minute: "2-digit", timeZoneName: "short"});

// A time of the API in the reader's own zone, with UTC as its title.
export function dateTime(text) {
  return h("time", {class: "absolute", datetime: text, title: exactly(text)}, ABSOLUTE.format(new Date(text)));
}

export function keepTimesCurrent() {
  setInterval(() => {
    for (const element of document.querySelectorAll("time:not(.absolute)")) {
      const now = relative(new Date(element.dateTime));
      if (element.textContent !== now) element.textContent = now;
    }
  }, 5000);
}

const STATES = {queued: "waits", running: "is played", done: "done", failed: "failed",
  cancelled: "cancelled", grader_error: "grader's fault"};

export function state(word) {
  return h("span", {class: `state ${word}`}, STATES[word] ?? word);
}

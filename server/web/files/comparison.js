// Two submissions episode by episode: what each of the same episodes gained or lost.
import {get} from "./api.js";
import {h, href, replace, s, table} from "./dom.js";
import {heading, number, visible, whole} from "./format.js";
import {nameOf, others} from "./replay_compare.js";

// 97.5 % quantiles of Student's distribution with 1 to 4 degrees of freedom.
const FEW = [12.706, 4.303, 3.182, 2.776];
const Z = 1.959964;
const BETTER = {more: 1, less: -1, neither: 0};

// The same for any number of them: above 4 by the expansion around the normal distribution, to 0.001.
function quantile(freedom) {
  if (freedom <= FEW.length) return FEW[freedom - 1];
  return Z + (Z ** 3 + Z) / (4 * freedom) + (5 * Z ** 5 + 16 * Z ** 3 + 3 * Z) / (96 * freedom ** 2)
    + (3 * Z ** 7 + 19 * Z ** 5 + 17 * Z ** 3 - 15 * Z) / (384 * freedom ** 3);
}

// The mean of differences with Student's 95 % interval for paired samples, unless they are all the same, and how many
// are wins, losses and ties, if more (1) or less (-1) is better.
export function pairedDifference(differences, better) {
  const count = differences.length;
  const mean = differences.reduce((sum, one) => sum + one, 0) / count;
  const squares = differences.reduce((sum, one) => sum + (one - mean) ** 2, 0);
  const half = squares > 0 ? quantile(count - 1) * Math.sqrt(squares / (count - 1) / count) : null;
  const wins = differences.filter((one) => one * better > 0).length;
  const ties = differences.filter((one) => one === 0).length;
  return {count, mean, low: half === null ? null : mean - half, high: half === null ? null : mean + half, wins, ties,
    losses: count - wins - ties};
}

// Metrics by episode: by its index if both played the same seeds, else by its seed. A fault is no success either.
function byEpisode({episode_columns: columns}, same) {
  return new Map(columns.index.map((index, place) => {
    const outcome = columns.outcome[place];
    return [same ? index : columns.seed[place], {...columns.metrics[place],
      success: outcome === null ? null : Number(outcome === "success")}];
  }).filter(([key]) => key !== null));
}

// Pairs of the metrics that two submissions measured in the same episodes.
export function pairsOf(own, other) {
  if (own.hashes.config !== other.hashes.config) throw new Error("It was played by other rules.");
  const same = own.hashes.seeds === other.hashes.seeds;
  const theirs = byEpisode(other, same);
  return [...byEpisode(own, same)].filter(([key]) => theirs.has(key)).map(([key, mine]) => [mine, theirs.get(key)]);
}

const WIDTH = 220;
const HEIGHT = 34;

// Each difference as a dot, and the mean with its interval, around a line at no difference.
function chart(differences, {mean, low, high}, better, words) {
  const most = Math.max(...differences.map(Math.abs), Math.abs(low ?? 0), Math.abs(high ?? 0)) || 1;
  const x = (value) => WIDTH / 2 * (1 + 0.94 * value / most);
  const y = HEIGHT / 2;
  const kind = (one) => (one * better > 0 ? "success" : one * better < 0 ? "failure" : "");
  return s("svg", {class: "differences", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, role: "img",
    "aria-label": words}, s("line", {class: "axis", x1: x(0), x2: x(0), y1: 0, y2: HEIGHT}),
  differences.slice(0, 1000).map((one, place) => s("circle", {class: `dot ${kind(one)}`, cx: x(one),
    cy: y + (place * 0.618 % 1 - 0.5) * 0.7 * HEIGHT, r: 2.4})),
  low !== null && s("line", {class: "interval", x1: x(low), x2: x(high), y1: y, y2: y}),
  s("rect", {class: "mean", x: x(mean) - 1.5, y: y - 6, width: 3, height: 12}));
}

const signed = (value, digits) => (value === null ? "–" : `${value > 0 ? "+" : value < 0 ? "−" : ""}`
  + number(Math.abs(value), digits));

function row(metric, pairs) {
  const differences = pairs.map(([own, other]) => [own[metric.name], other[metric.name]])
    .filter((both) => both.every((value) => typeof value === "number")).map(([own, other]) => own - other);
  if (!differences.length) return null;
  const better = BETTER[metric.better] ?? 0;
  const found = pairedDifference(differences, better);
  const text = (value) => signed(value, metric.digits);
  const interval = found.low === null ? "–" : `${text(found.low)} to ${text(found.high)}`;
  const clear = found.low !== null && (found.low > 0 || found.high < 0);
  const verdict = clear && better ? (found.mean * better > 0 ? "success" : "failure") : "";
  return h("tr", null, h("th", {scope: "row"}, heading(metric)),
    h("td", {class: "num"}, whole(found.count)),
    h("td", {class: "num"}, h("b", {class: `difference ${verdict}`}, text(found.mean))), h("td", {class: "num"}, interval),
    better ? [found.wins, found.losses, found.ties].map((one) => h("td", {class: "num"}, whole(one)))
      : [0, 0].map(() => h("td", {class: "num"}, "–")).concat(h("td", {class: "num"}, whole(found.ties))),
    h("td", null, chart(differences, found, better, `${heading(metric)}: mean difference ${text(found.mean)}, 95 % ${
      interval}`)));
}

function result(own, other, name) {
  const pairs = pairsOf(own, other);
  if (!pairs.length) throw new Error("It has played none of these seeds.");
  const success = {name: "success", title: "success", unit: "", digits: 2, better: "more"};
  const metrics = [success, ...own.metrics.filter((metric) => !metric.name.startsWith("success"))];
  const rows = metrics.map((metric) => row(metric, pairs)).filter((one) => one);
  if (!rows.length) throw new Error("Nothing that both measured can be seen.");
  return [h("p", null, `${whole(pairs.length)} episodes on the same seeds; each difference is this submission less ${
    visible(name)}.`),
  table("Differences", ["Metric", "Pairs#", "Mean difference#", "95 % interval#", "Better#", "Worse#", "Equal#",
    "Each episode"], rows),
  h("p", {class: "quiet"}, "Student's interval for paired samples, of each metric by itself: where it leaves out 0, luck with "
    + "these seeds alone hardly explains the difference; there is none where all differences are the same. Metrics that only some episodes have are compared where both have "
    + "them.")];
}

// Offers others to compare a submission with, once the reader asks.
export function comparison(status) {
  const box = h("div", null, h("p", {class: "quiet"}, "Looking for others…"));
  const columns = (id) => get(`/v1/submissions/${id}/result?episodes=1&fields=seed,outcome,metrics`);
  const look = async () => {
    try {
      const found = await others(status);
      if (!found.length) {
        replace(box, h("p", {class: "quiet"}, "You may see no other submission on this board."));
        return;
      }
      const shown = h("div", {"aria-live": "polite"});
      const choice = h("select", {id: "compared-with"}, found.map((one) => h("option", {value: one.submission},
        `${Number.isFinite(one.rank) ? `${one.rank}. ` : ""}${visible(nameOf(one))}`)));
      const show = async (event) => {
        event.preventDefault();
        const other = found.find((one) => one.submission === Number(choice.value));
        try {
          const [own, theirs] = await Promise.all([columns(status.submission), columns(other.submission)]);
          replace(shown, result(own, theirs, nameOf(other)), h("p", null, h("a", {href: href("/submission",
            {id: other.submission})}, "Open the other submission")));
        } catch (error) {
          replace(shown, h("p", {class: "problem"}, visible(error.message)));
        }
      };
      replace(box, h("form", {class: "row", onsubmit: show}, h("label", {for: "compared-with", class: "inline"},
        "Submission ", choice), h("button", {type: "submit"}, "Compare")), shown);
    } catch (error) {
      replace(box, h("p", {class: "problem"}, visible(error.message)));
    }
  };
  return h("details", {class: "card compare", ontoggle: (event) => {
    if (!event.target.open || box.dataset.asked) return;
    box.dataset.asked = "yes";
    look();
  }}, h("summary", null, "Compare with another submission, episode by episode"), box);
}

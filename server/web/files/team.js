// A team: what it may still submit, what it was charged, and its submissions.
import {get, isOrganiser, whoami} from "./api.js";
import {facts, h, href, replace, table} from "./dom.js";
import {boardTitle, name, state, time, visible, whole} from "./format.js";
import {phaseTitles, phasesKnown, placesOf, placesTable} from "./places.js";
import {progress} from "./progress.js";

const MOST_CHARTS = 6;
const LIMITS = [["official", "per_day", "Ranked today"], ["official", "total", "Ranked in all"],
  ["practice", "per_day", "Practice today"], ["practice", "total", "Practice in all"],
  ["failed", "per_day", "Failed today"], ["failed", "total", "Failed in all"]];

function gauge(title, of) {
  const most = of.limit + (of.granted ?? 0);
  const used = of.used + (of.open ?? 0);
  return h("div", {class: "gauge"},
    h("span", null, title),
    h("span", {class: "num"}, `${whole(used)} of ${whole(most)}`),
    h("meter", {min: 0, max: Math.max(most, 1), value: Math.min(used, most), "aria-label":
      `${title}: ${used} of ${most}`}));
}

function inUse(entry) {
  return entry.waiting.used > 0 || LIMITS.some(([budget, span]) => entry[budget]?.[span]?.used
    || entry[budget]?.[span]?.open || entry[budget]?.[span]?.granted);
}

// Phases in the order of their files. What the team has not used of tracks and of phases that are over is folded away.
function quotas(quota, titleOf, phases) {
  const places = [...phases.keys()];
  const all = [...quota.phases.toSorted((a, b) => places.indexOf(a.phase) - places.indexOf(b.phase)), ...quota.tracks];
  const idle = all.filter((one) => !inUse(one) && (!one.phase || phases.get(one.phase)?.state === "closed"));
  const cards = (entries) => h("div", {class: "cards"}, entries.map((one) => quotaCard(titleOf(one),
    one.phase ? {phase: one.phase} : {track: one.track}, one)));
  return [cards(all.filter((one) => !idle.includes(one))), idle.length > 0 && h("details", {class: "more"},
    h("summary", null, `Quota of ${idle.map(titleOf).join(", ")}`), cards(idle))];
}

function quotaCard(title, query, entry) {
  return h("section", {class: "card"}, h("h3", null, h("a", {href: href("/board", query)}, title)),
    gauge("Waiting", entry.waiting),
    LIMITS.filter(([budget, span]) => entry[budget]?.[span]).map(([budget, span, words]) =>
      gauge(words, entry[budget][span])));
}

const ENTRIES = {charge: "charged", refund: "refunded", grant: "granted"};

const ledgerRow = (titleOf) => (row) => {
  return h("tr", null, h("td", null, time(row.at)),
    h("th", {scope: "row"}, ENTRIES[row.entry] ?? row.entry),
    h("td", {class: "num"}, whole(row.amount)), h("td", null, row.budget),
    h("td", null, titleOf(row)),
    h("td", null, row.submission ? h("a", {href: href("/submission", {id: row.submission})},
      `${row.submission}`) : "–"),
    h("td", {class: "wide"}, visible(row.why ?? "")));
};

const submissionRow = (titleOf) => (row) => {
  const {success, done, total} = row.episodes;
  return h("tr", null,
    h("td", {class: "num"}, row.submission),
    h("th", {scope: "row"}, h("a", {href: href("/submission", {id: row.submission})},
      name(row.name || `submission ${row.submission}`)),
    !row.ranked && h("span", {class: "tag"}, "practice")),
    h("td", null, titleOf(row)), h("td", null, state(row.state)),
    h("td", {class: "num"}, `${whole(done)} of ${whole(total)}`),
    h("td", {class: "num"}, whole(success)), h("td", null, time(row.accepted_at)));
};

// A table whose further pages come by a button.
function pages(label, heads, address, key, row) {
  const body = h("tbody");
  const more = h("button", {type: "button", hidden: true, onclick: () => load()}, "Show older");
  const empty = h("p", {class: "empty", hidden: true}, "There are none.");
  let next = null;
  async function load() {
    more.disabled = true;
    const joint = address.includes("?") ? "&" : "?";
    const page = await get(address + (next ? `${joint}before=${next}` : ""));
    body.append(...page[key].map(row));
    next = page.next_before;
    more.hidden = next === null;
    more.disabled = false;
    empty.hidden = body.childNodes.length > 0;
  }
  const box = table(label, heads, []);
  box.querySelector("tbody").replaceWith(body);
  return [h("div", null, box, empty, more), load()];
}

// What everybody may see of a team: where it stands.
async function showPlaces(main, team) {
  document.title = `${visible(team)} – MyoGrade`;
  const places = await placesOf(team);
  const charts = h("div", {class: "charts"});
  replace(main, h("h1", null, name(team)), h("h2", null, "Places"), places.length ? [placesTable(places), charts]
    : h("p", {class: "empty"}, "No board that you may see has a team of this name."));
  main.dataset.ready = "yes";
  // What takes several requests for each board comes afterwards.
  (async () => {
    for (const place of places.slice(0, MOST_CHARTS)) {
      const figure = await progress(team, place, `${visible(place.title)}${place.board === "main" ? ""
        : `, ${boardTitle(place.board)}`}`);
      if (figure) charts.append(figure);
    }
  })().catch((error) => charts.append(h("p", {class: "problem"}, visible(error.message))));
}

// What its members and organisers see besides.
async function showTeam(main, team) {
  const at = encodeURIComponent(team);
  const [info, quota, titleOf, phases] = await Promise.all([get(`/v1/teams/${at}`),
    get(`/v1/quota?team=${at}&limit=1`), phaseTitles(), phasesKnown()]);
  await showPlaces(main, info.team);
  const [ledger, ledgerLoaded] = pages("Ledger of the quota",
    ["When", "Entry", "Amount#", "Budget", "For", "Submission", "Why"],
    `/v1/quota?team=${at}&limit=20`, "ledger", ledgerRow(titleOf));
  const [list, listLoaded] = pages("Submissions",
    ["Number#", "Policy", "For", "State", "Episodes#", "Successes#", "Handed in"],
    `/v1/submissions?team=${at}&limit=50`, "submissions", submissionRow(titleOf));
  main.append(...[
    info.banned && h("p", {class: "problem"}, "The organisers have banned this team."),
    facts([["Members", info.members.length ? info.members.join(", ") : "–"],
      ["Submissions", whole(info.submissions)],
      ["Other names", info.other_names.length
        ? info.other_names.map((one, place) => [place ? ", " : "", name(one)]) : "–"],
      ["Next day begins", time(quota.next_day_at)]]),
    h("h2", null, "Submissions"), list,
    h("h2", null, "Quota"), quotas(quota, titleOf, phases),
    h("h2", null, "Ledger"), ledger].flat(Infinity).filter((one) => one));
  await Promise.all([ledgerLoaded, listLoaded]);
}

async function showTeams(main, who) {
  document.title = "Teams – MyoGrade";
  if (!isOrganiser(who)) {
    replace(main, h("h1", null, "Teams"), who.teams.length ? h("ul", {class: "plain"},
      who.teams.map((team) => h("li", null, h("a", {href: href("/team", {name: team})},
        name(team))))) : h("p", {class: "empty"}, who.role === "public"
      ? ["Teams are shown to their members: ",
        h("a", {href: href("/sign-in", {to: "/team"})}, "sign in"), "."]
      : "You are in no team yet."));
    return;
  }
  const [list, loaded] = pages("Teams", ["Team", "Submissions#", "Users of the host#", "Tokens#", "Since"],
    "/v1/teams?limit=100", "teams", (team) => h("tr", null,
      h("th", {scope: "row"}, h("a", {href: href("/team", {name: team.team})}, name(team.team)),
        team.banned && h("span", {class: "tag bad"}, "banned")),
      h("td", {class: "num"}, whole(team.submissions)),
      h("td", {class: "num"}, whole(team.members.length)), h("td", {class: "num"}, whole(team.tokens)), h("td", null, time(team.created_at))));
  replace(main, h("h1", null, "Teams"), list);
  await loaded;
}

export async function show(main, query) {
  const who = await whoami();
  const team = query.get("name");
  if (team && !isOrganiser(who) && !who.teams.includes(team)) await showPlaces(main, team);
  else if (team) await showTeam(main, team);
  else if (!isOrganiser(who) && who.teams.length === 1) await showTeam(main, who.teams[0]);
  else await showTeams(main, who);
}

// An episode in 3D, or two beside each other with one clock: /replay?log=HASH&of=SUBMISSION. Where the
// browser can't draw in 3D, graphs and events still follow.
import {download, get, token} from "./api.js";
import {facts, h, href, replace} from "./dom.js";
import {bytes, name, number, visible, whole} from "./format.js";
import {Clock} from "./replay_clock.js";
import {keepMoment, momentAsked} from "./replay_address.js";
import {compare} from "./replay_compare.js";
import {Controls, eventTable, keyList, seconds} from "./replay_controls.js";
import {MOST_BYTES, readTrajectory} from "./replay_file.js";
import {Film, filmType} from "./replay_film.js";
import {graphs} from "./replay_graphs.js";
import {Player, makeViews} from "./replay_player.js";
import {filesOf, publicReplays, replayAddress} from "./replays.js";
import {save as saveFile} from "./sheet.js";

const MARKS = ["first", "second"];

function asked(query) {
  const logs = query.getAll("log");
  const of = query.getAll("of");
  if (logs.length < 1 || logs.length > 2 || !logs.every((log) => /^[0-9a-f]{64}$/.test(log))
      || !of.every((id) => /^\d{0,18}$/.test(id))) {
    throw new Error("The address names no replay: it ends as in /replay?log=HASH, where HASH is the "
      + "SHA-256 of an episode's log, and may name two.");
  }
  return logs.map((log, place) => ({log, of: of[place] || null, mark: MARKS[place]}));
}

function waiting({state, place}) {
  if (state === "playing") return "The episode is played again from its log…";
  return place > 0 ? `The episode waits to be played again; ${whole(place)} others come first.`
    : "The episode is played again as soon as there is room…";
}

// The trajectory of an episode and the submission that it is of, if the reader may see that.
async function load(one, tell, signal) {
  const open = (await publicReplays()).find(({log}) => log === one.log);
  const known = one.of && (token() || !open);
  const status = known ? get(`/v1/submissions/${one.of}`, signal).catch(() => null) : null;
  const {data, received} = await download(`${filesOf(one.log, open)}/trajectory`, {signal, most: MOST_BYTES,
    onWait: (state) => tell(waiting(state)),
    onProgress: (count) => tell(`Loading the poses: ${bytes(count)}…`)});
  return {...one, trajectory: readTrajectory(data), received, open, status: await status};
}

function labelled(episodes) {
  return episodes.map((one) => {
    const known = one.status ?? one.open;
    const own = known && (known.name || `submission ${known.submission}`);
    const of = known ? `${known.team}: ${own}` : one.of ? `submission ${one.of}` : null;
    const alone = episodes.length === 1 ? "the episode" : `${one.mark} episode`;
    return {...one, label: visible(of ?? alone)};
  });
}

function about(one) {
  const {trajectory} = one;
  return h("div", {class: `about ${one.mark}`}, facts([
    ["Policy", one.of && (one.status || !one.open) ? h("a", {href: href("/submission", {id: one.of})}, name(one.label))
      : h("span", null, one.label)],
    ["Episode", trajectory.episode === null ? null : whole(trajectory.episode)],
    ["Ended", `${visible(trajectory.end) || "–"}, after ${seconds(trajectory.duration)}`],
  ].filter((pair) => pair[1] !== null)));
}

function fileName({track, episode}, ...more) {
  return [track, ...(episode === null ? [] : [`episode-${episode}`]), ...more].join("-").replace(/[^\w.-]/g, "_");
}

function actions(views, episodes, clock, film) {
  const save = () => views.forEach(async (view, place) => {
    const words = fileName(episodes[place].trajectory, `${clock.time.toFixed(2)}s`, ...(place ? [place + 1] : []));
    saveFile(await view.picture(), `${words}.png`, "image/png");
  });
  const each = (act) => (...values) => views.forEach((view) => act(view, ...values));
  return {look: each((view, from) => view.lookFrom(from)),
    turn: each((view, ...by) => view.turn(...by)),
    canFollow: views.some((view) => view.followed), follow: each((view, on) => {
      view.following = on;
    }),
    muscles: each((view, on) => view.showMuscles(on)), forces: each((view, on) => view.showForces(on)),
    names: views.some((view) => view.trajectory.contacts.bodiesOf) && each((view, on) => view.showNames(on)),
    save: views.length > 0 && save, film};
}

// What a frame takes, for those who want to know: of the scripts, without the graphics card's part.
class Meter {
  constructor() {
    this.frames = 0;
    this.scripts = 0;
    this.since = performance.now();
    this.element = h("p", {class: "quiet"});
  }

  add(took, views) {
    this.frames += 1;
    this.scripts += took;
    const now = performance.now();
    if (now - this.since < 1000) return;
    const rate = 1000 * this.frames / (now - this.since);
    const sum = (of) => views.reduce((all, view) => all + view.stats[of], 0);
    this.element.textContent = `${rate < 1 ? "at rest" : `${number(rate, 0)} frames/s`}, scripts `
      + `${number(this.scripts / this.frames, 2)} ms per frame, ${whole(sum("calls"))} draw calls, `
      + `${whole(sum("triangles"))} triangles`;
    Object.assign(this.element.dataset, {scripts: this.scripts / this.frames, calls: sum("calls"),
      triangles: sum("triangles")});
    this.frames = 0;
    this.scripts = 0;
    this.since = now;
  }
}

function stageOf(episodes, hosts, why) {
  return h("div", {class: `stage${episodes.length > 1 ? " two" : ""}`}, why
    ? h("p", {class: "notice", role: "status"}, why)
    : episodes.map((one, place) => h("figure", {class: `view ${one.mark}`}, hosts[place],
      episodes.length > 1 && h("figcaption", null, one.label))));
}

function legend(episodes) {
  const strong = Math.max(...episodes.map((one) => one.trajectory.strongForce));
  const muscles = episodes.some((one) => one.trajectory.muscles.length > 0);
  const targets = episodes.some((one) => one.trajectory.bodies.some((body) => body.target));
  return h("p", {class: "quiet scale"}, muscles && ["Muscles: at rest ",
    h("span", {class: "tones", "aria-hidden": "true"}), " fully active. "],
  strong > 0 && `Arrows: contact forces; the longest stands for ${number(strong, 0)} N, one of half its length for a quarter. `,
  targets && "Translucent: the target. ",
  [...new Set(episodes.map((one) => visible(one.trajectory.legend)))].join(" "));
}

// The episodes before and after this one, as far as the reader may see them.
function neighbours(own) {
  const {episode} = own.trajectory;
  const box = h("nav", {class: "row neighbours", "aria-label": "Episodes"});
  const link = (row, words) => row?.log && h("a", {class: "button", href: replayAddress({log: row.log.sha256,
    of: own.of})}, words(row.index));
  get(`/v1/submissions/${own.of}/result?episodes=1&first=${Math.max(episode - 1, 0)}&last=${episode + 1}&details=0`)
    .then(({episode_rows: rows}) => replace(box,
      link(rows.find((row) => row.index === episode - 1), (index) => `← Episode ${index}`),
      h("a", {href: `${href("/submission", {id: own.of})}#episode-${episode}`}, "All episodes"),
      link(rows.find((row) => row.index === episode + 1), (index) => `Episode ${index} →`)), () => {});
  return box;
}

async function build(main, title, episodes, tell, signal) {
  const clock = new Clock(Math.max(...episodes.map((one) => one.trajectory.duration)),
    Math.min(...episodes.map((one) => one.trajectory.period)));
  const hosts = episodes.map((one) => h("div", {class: "canvas", tabindex: 0, role: "group",
    "aria-label": `3D view, ${one.label}. Space plays, arrow keys step; the events below tell what `
      + "happens."}));
  let player = null;
  let keep = null;
  const again = () => {
    if (player) player.changed = true;
    keep?.();
  };
  const {views, viewpoints, why} = await makeViews(episodes, hosts, tell, again, signal);
  const film = views.length && clock.duration && filmType() ? new Film(clock, views, episodes.map((one) => `${one.label}, ${
    visible(one.trajectory.track)}${one.trajectory.episode === null ? "" : `, episode ${whole(one.trajectory.episode)}`}`),
  fileName(episodes[0].trajectory)) : null;
  const controls = new Controls(episodes, clock, viewpoints, actions(views, episodes, clock, film), again);
  const wanted = momentAsked();
  if (wanted.camera) views.forEach((view) => view.placeCamera(wanted.camera));
  clock.seek(wanted.time ?? 0);
  keep = keepMoment(clock, views);
  const onSeek = (time) => controls.seek(time);
  const drawn = graphs(episodes, clock.duration, onSeek);
  const events = eventTable(episodes, onSeek);
  const meter = new Meter();
  document.addEventListener("keydown", (event) => {
    if (controls.key(event)) event.preventDefault();
  });
  const box = h("section", {class: "replay", "aria-label": "Replay"}, stageOf(episodes, hosts, why), controls.element, views.length > 0 && legend(episodes));
  const own = episodes.length === 1 ? episodes[0] : null;
  const numbered = own?.status && Number.isInteger(own.trajectory.episode);
  replace(main, title, h("div", {class: "row over-view"}, h("div", {class: "abouts"}, episodes.map(about)),
    numbered && neighbours(own)),
    h("div", {class: "replay-and-graphs"}, box, drawn.element),
    numbered && compare(own.status, {log: own.log, index: own.trajectory.episode}), h("h2", null, "Events"), events.element, keyList(), h("details", {class: "more"}, h("summary", null, "About the drawing"),
      meter.element, h("p", {class: "quiet"}, episodes.map((one) => `${one.label}: `
        + `${bytes(one.received)} of poses, ${whole(one.trajectory.frames)} frames, `
        + `${whole(one.trajectory.steps)} steps`).join("; "))));
  player = new Player(clock, views, [drawn, events], controls, meter, film);
  hosts.forEach((host) => host.addEventListener("pointerdown", again));
  // A moment that somebody shared stands still.
  if (wanted.time === null && views.length && !matchMedia("(prefers-reduced-motion: reduce)").matches) controls.toggle();
  return player;
}

export async function show(main, query) {
  const wanted = asked(query);
  const words = h("span", {role: "status"}, "Loading the poses…");
  const title = h("h1", null, wanted.length > 1 ? "Two replays" : "Replay");
  document.title = "Replay – MyoGrade";
  const bar = h("progress", {"aria-label": "Loading"});
  replace(main, title, h("p", {class: "loading"}, bar, " ", words));
  const leaving = new AbortController();
  let player = null;
  addEventListener("pagehide", () => {
    leaving.abort();
    player?.end();
  }, {once: true});
  // A page that a browser kept has nothing to show any more.
  addEventListener("pageshow", (event) => event.persisted && location.reload());
  const tell = (text, part) => {
    if (words.textContent !== text) words.textContent = text;
    if (part > 0) bar.value = part;
    else bar.removeAttribute("value");
  };
  const episodes = labelled(await Promise.all(wanted.map((one) => load(one, tell, leaving.signal))));
  const [first] = episodes;
  const of = first.status ?? first.open;
  const team = of ? `${of.team}, ` : "";
  title.textContent = `Replay: ${visible(`${team}${first.trajectory.track}`)}`
    + (first.trajectory.episode === null ? "" : `, episode ${whole(first.trajectory.episode)}`);
  document.title = `${title.textContent} – MyoGrade`;
  tell("Loading the model…");
  player = await build(main, title, episodes, tell, leaving.signal);
}

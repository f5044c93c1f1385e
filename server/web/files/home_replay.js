// On the first page: an episode that everybody may watch, in a loop. Its picture stands for it until it is loaded,
// where the browser can't draw in 3D, and where the reader asks for less motion or fewer bytes.
import {download} from "./api.js";
import {h, href} from "./dom.js";
import {name, visible, whole} from "./format.js";
import {picture} from "./pictures.js";
import {Clock} from "./replay_clock.js";
import {MOST_BYTES, readTrajectory} from "./replay_file.js";
import {Player, makeViews} from "./replay_player.js";
import {filesOf, replayAddress} from "./replays.js";

const REST_S = 1;  // before it begins anew
const NOTHING = {show() {}, add() {}};  // controls and a meter that tell nothing

// Draws the episode in `host` until the page is left; whether it can.
async function play(host, log, clock) {
  const leaving = new AbortController();
  const {signal} = leaving;
  const {data} = await download(`${filesOf(log, true)}/trajectory`, {signal, most: MOST_BYTES});
  const trajectory = readTrajectory(data);
  Object.assign(clock, {duration: trajectory.duration + REST_S, period: trajectory.period, loop: true});
  let player = null;
  const {views} = await makeViews([{trajectory}], [host], () => {}, () => {
    if (player) player.changed = true;
  }, signal);
  if (!views.length) return false;
  player = new Player(clock, views, [], NOTHING, NOTHING);
  addEventListener("pagehide", () => {
    leaving.abort();
    player.end();
  }, {once: true});
  return true;
}

// `replay` is one of publicReplays, `title` what its board is called.
export function homeReplay(replay, title) {
  const {log, submission, team, episode, baseline} = replay;
  const address = replayAddress({log, of: submission});
  const clock = new Clock(0, 1);
  const words = `${visible(team)}${baseline ? ", a baseline" : ", the leader"}, in episode ${whole(episode)} of `
    + `“${visible(title)}”`;
  const still = picture(filesOf(log, true), `A moment of ${words}`);
  const host = h("div", {class: "canvas", role: "img", "aria-label": `${words}, in motion`, hidden: true});
  let wanted = true;  // by the reader
  const button = h("button", {type: "button", hidden: true, onclick: () => {
    wanted = !wanted;
    button.textContent = wanted ? "Pause" : "Play";
    if (wanted) clock.play();
    else clock.pause();
  }}, "Pause");
  const box = h("figure", {class: "view home-replay"}, still, host, h("figcaption", {class: "row"},
    h("span", null, h("a", {href: href("/team", {name: team})}, name(team)),
      baseline ? ", a baseline" : ", the leader", `, in episode ${whole(episode)} of “${visible(title)}”`),
    button, h("a", {class: "button", href: address}, "Open the replay")));
  if (matchMedia("(prefers-reduced-motion: reduce)").matches || navigator.connection?.saveData) return box;
  let loading = null;
  // It is loaded once it is seen, and stands still while it isn't.
  new IntersectionObserver(async ([{isIntersecting: seen}]) => {
    if (seen && loading === null) {
      host.hidden = false;  // a view needs a size
      loading = play(host, log, clock).catch((error) => {
        if (error.status === 404) box.hidden = true;  // its log was removed
        return false;
      });
      const drawn = await loading;
      host.hidden = !drawn;
      still.hidden = drawn;
      button.hidden = !drawn;
      box.dataset.drawn = drawn ? "yes" : "no";
      if (drawn && wanted) clock.play();
    } else if (seen && wanted && clock.duration) clock.play();
    else if (!seen) clock.pause();
  }, {rootMargin: "100px"}).observe(box);
  return box;
}

// What runs a replay: the views in 3D of its episodes, and the loop that draws them by a clock.
import {ApiError, download} from "./api.js";
import {bytes, visible} from "./format.js";
import {FileError, MOST_BYTES} from "./replay_file.js";

const TOLD_MS = 150;  // how often words that change are written anew
const SLOW_MS = 40;   // a frame that takes longer makes the view simpler
const NO_WEBGL = "This browser can't draw in 3D here: WebGL 2 is missing or switched off. Graphs and "
  + "events below show the episode.";

function whyNot(error) {
  if (error instanceof ApiError || error instanceof FileError) return visible(error.message);
  if (/webgl/i.test(error.message)) return NO_WEBGL;
  reportError(error);
  return "The view in 3D failed. Graphs and events below show the episode.";
}

// How many bytes a model file has in all, as its head says: what arrives is unpacked, of which HTTP tells no size.
function wholeModel(head) {
  return head.byteLength < 12 ? Infinity : new DataView(head.buffer, head.byteOffset).getUint32(8, true);
}

// The views in 3D, or none and why. tell(words, part): how far it is, of 1, if that is known.
export async function makeViews(episodes, hosts, tell, again, signal) {
  let drawing;
  try {
    drawing = await import("./replay_view.js");
  } catch (error) {
    if (signal.aborted) throw error;
    return {views: [], viewpoints: [], why: "What draws in 3D could not be loaded: reload the page."};
  }
  if (!drawing.canDraw()) return {views: [], viewpoints: [], why: NO_WEBGL};
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const strong = Math.max(...episodes.map((one) => one.trajectory.strongForce));
  const views = [];
  const models = new Map();
  try {
    for (const [place, one] of episodes.entries()) {
      const {track} = one.trajectory;
      if (!models.has(track)) {
        models.set(track, (await download(`/v1/models/${encodeURIComponent(track)}.glb`,
          {signal, most: MOST_BYTES, onWait: () => tell("The model's shapes are made…"),
            onProgress: (received, head) => tell(`Loading the model: ${bytes(received)}…`,
              received / wholeModel(head))})).data);
      }
      const onMove = (moved) => {
        views.forEach((view) => view !== moved && view.lookLike(moved));
        again();
      };
      const model = await drawing.readModel(models.get(track));
      views.push(new drawing.View(hosts[place], one.trajectory, model, {dark, strong, onMove}));
    }
  } catch (error) {
    views.forEach((view) => view.dispose());
    if (signal.aborted) throw error;
    return {views: [], viewpoints: [], why: whyNot(error)};
  }
  return {views, viewpoints: drawing.VIEWPOINTS, why: null};
}

// Runs the clock and draws while something changes.
export class Player {
  // `film` of replay_film.js, or null.
  constructor(clock, views, parts, controls, meter, film = null) {
    Object.assign(this, {clock, views, parts, controls, meter, film, changed: true, before: null, told: 0,
      slow: 0, spared: 0});
    this.request = requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.request = requestAnimationFrame((next) => this.frame(next));
    const passed = this.before === null ? 0 : now - this.before;
    this.before = now;
    const ran = this.clock.running;
    this.clock.pass(passed / 1000);
    if (!ran && !this.changed && !this.views.some((view) => view.controls.state >= 0)) return;
    const begin = performance.now();
    this.changed = false;
    const told = !this.clock.running || now - this.told > TOLD_MS;
    if (told) this.told = now;
    this.controls.show(told);
    this.parts.forEach((part) => part.show(this.clock.time, told));
    for (const view of this.views) view.draw(this.clock.time);
    this.film?.add();
    this.meter.add(performance.now() - begin, this.views);
    this.spare(ran ? passed : 0);
  }

  // A computer that can't keep up is asked for less, twice at most. Frames that were slow because
  // nobody saw the page don't count.
  spare(passed) {
    if (document.hidden) return;
    if (passed <= SLOW_MS) this.slow = Math.max(this.slow - 1, 0);
    else this.slow += passed > 5 * SLOW_MS ? 5 : 1;
    if (this.slow < 20 || this.spared >= 2) return;
    this.slow = 0;
    this.spared += 1;
    this.views.forEach((view) => view.simplify(this.spared));
  }

  // Ends it and frees what it has.
  end() {
    cancelAnimationFrame(this.request);
    this.views.splice(0).forEach((view) => view.dispose());
  }
}

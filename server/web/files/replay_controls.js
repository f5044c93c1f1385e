// What a replay is steered with: buttons, the bar with its marks, keys, and the list of events.
import {h, table} from "./dom.js";
import {number, visible} from "./format.js";
import {SPEEDS} from "./replay_clock.js";

const JUMP_S = 0.5;
const BRIEF_S = 0.05;

export function seconds(time) {
  return `${number(time, 2)} s`;
}

function button(words, title, onclick, more = {}) {
  return h("button", {type: "button", title, onclick, ...more}, words);
}

function choice(words, options, onChange) {
  return h("select", {"aria-label": words, title: words, onchange: (event) => onChange(event.target.value)},
    options.map(([value, text]) => h("option", {value}, text)));
}

function tick(words, checked, onChange) {
  const element = h("input", {type: "checkbox", checked, onchange: () => onChange(element.checked)});
  return {element, label: h("label", {class: "inline"}, element, " ", words)};
}

const WHAT = {first_contact: "first contact", handover: "handover", release: "release",
  goal_contact: "contact with the goal", peak_force: "peak force", leg_state: "state of the leg",
  fall: "fall", target: "target", end: "end"};

// What an event is, in words: its kind and what the file says of it, unless that is a sentence of its own.
export function eventWords(event) {
  const kind = Object.hasOwn(WHAT, event.kind) ? WHAT[event.kind]
    : visible(event.kind.replaceAll("_", " "));
  const said = visible(event.text);
  const value = event.value === null ? "" : `${number(event.value, 2)} ${visible(event.unit)}`.trim();
  return [/^\p{Lu}/u.test(said) ? said : said && said !== kind ? `${kind}: ${said}` : kind, value && !said.includes(value)
    ? ` (${value})` : ""].join("");
}

// Without the states that do not last: a threshold may be crossed to and fro in some control steps.
export function lasting(events) {
  let next = Infinity;
  return events.toReversed().filter(({kind, time}) => {
    if (kind !== "leg_state") return true;
    const lasts = next - time >= BRIEF_S;
    next = time;
    return lasts;
  }).reverse();
}

// The bar of an episode's time, with a line of marks for each episode.
function bar(episodes, clock, onSeek) {
  const slider = h("input", {type: "range", min: 0, max: clock.duration, step: "any", value: 0,
    "aria-label": "Time", oninput: () => onSeek(Number(slider.value))});
  const marks = episodes.map((one) => h("div", {class: `marks ${one.mark}`, "aria-hidden": "true"},
    lasting(one.trajectory.events).map((event) => {
      const mark = h("span", {class: `mark ${event.kind.replace(/[^a-z_]/g, "")}`,
        title: `${seconds(event.time)}: ${eventWords(event)}`});
      mark.style.left = `${100 * Math.min(Math.max(event.time / (clock.duration || 1), 0), 1)}%`;
      return mark;
    })));
  return {slider, element: h("div", {class: "timebar"}, slider, marks)};
}

// All events, each of which can be gone to: the replay for those who don't see it.
export function eventTable(episodes, onSeek) {
  const all = episodes.flatMap((one) => lasting(one.trajectory.events).map((event) => ({one, event})))
    .sort((a, b) => a.event.time - b.event.time);
  if (!all.length) return {element: h("p", {class: "quiet"}, "Nothing was noted."), show() {}};
  const several = episodes.length > 1;
  const rows = all.map(({one, event}) => h("tr", null,
    h("td", {class: "num"}, button(seconds(event.time), "Go to this time",
      () => onSeek(event.time), {class: "small"})),
    several && h("td", {class: one.mark}, one.label), h("td", {class: "wide"}, eventWords(event))));
  let shown = -1;
  return {element: table("Events", ["Time#", ...(several ? ["Episode"] : []), "Event"], rows,
    {class: "events"}), show(time) {
    let now = -1;
    while (now + 1 < all.length && all[now + 1].event.time <= time + 1e-6) now += 1;
    if (now === shown) return;
    rows[shown]?.classList.remove("now");
    rows[now]?.classList.add("now");
    shown = now;
  }};
}

const KEYS = [["Space", "play or pause"], ["← →", "a frame back or on"],
  ["Shift ← →", "half a second back or on"], ["Home, End", "to the start or the end"],
  ["< >", "slower or faster"], ["A D", "turn the view"], ["W S", "tilt the view"],
  ["+ −", "nearer or farther"], ["0", "the first view"], ["F", "follow or stand still"],
  ["M", "muscles"], ["C", "contact forces"], ["N", "names of the bodies that touch"],
  ["L", "loop"], ["X", "full screen"]];

export function keyList() {
  return h("details", {class: "more"}, h("summary", null, "Keys and mouse"),
    h("dl", {class: "keys"}, KEYS.map(([key, words]) => h("div", null, h("dt", null, h("kbd", null,
      key)), h("dd", null, words)))),
    h("p", {class: "quiet"}, "Keys work everywhere but in fields. Drag to turn the view, drag with the right button or two fingers to shift it, turn the wheel or pinch to come "
      + "nearer."));
}

// Buttons and bar for a clock. `can` are the actions on the views: look(name), turn(azimuth, elevation,
// nearer), follow(on) if `canFollow`, muscles(on), forces(on), names(on) or false, save(), film (a Film or null); without views they are
// left out.
export class Controls {
  constructor(episodes, clock, viewpoints, can, onChange) {
    this.clock = clock;
    this.onChange = onChange;
    this.can = can;
    this.play = button("Play", "Space", () => this.toggle(), {class: "main"});
    this.time = h("output", {class: "time", "aria-live": "off"});
    this.bar = bar(episodes, clock, (time) => this.seek(time));
    this.speed = choice("Speed", SPEEDS.map((speed) => [speed, `${speed}×`]), (value) => {
      clock.speed = Number(value);
    });
    this.speed.value = "1";
    const changes = (act) => (value) => {
      act(value);
      this.changed();
    };
    this.view = choice("View", viewpoints.map((name) => [name, name === "close-up" ? name : `${name} view`]),
      changes(can.look));
    this.ticks = {follow: tick("Follow", true, changes(can.follow)),
      muscles: tick("Muscles", true, changes(can.muscles)),
      forces: tick("Forces", true, changes(can.forces)),
      names: tick("Names", false, changes(can.names)),
      loop: tick("Loop", false, (on) => {
        clock.loop = on;
      })};
    this.steering = h("div", null, this.bar.element, h("div", {class: "row"},
      this.play,
      button("−1", "One frame back (←)", () => this.step(-1)),
      button("+1", "One frame on (→)", () => this.step(1)), this.time, this.speed,
      viewpoints.length > 0 && [this.view, can.canFollow && this.ticks.follow.label,
        this.ticks.muscles.label, this.ticks.forces.label, can.names && this.ticks.names.label], this.ticks.loop.label,
      can.save && button("↓ Picture", "Saves what the view shows as a PNG", can.save),
      can.film && button("↓ Film", "Plays the episode from its start to its end and saves that as a film", () => this.record()),
      document.fullscreenEnabled && button("Full screen", "Full screen (X)", () => this.fullScreen())));
    this.element = h("div", {class: "controls"}, this.steering, can.film?.element);
    this.told = -Infinity;
    this.show(true);
  }

  // While a film is recorded, nothing else steers the clock.
  async record() {
    const asked = document.activeElement;
    this.steering.inert = true;
    await this.can.film.record().finally(() => {
      this.steering.inert = false;
      asked.focus();
      this.changed();
    });
  }

  fullScreen() {
    const box = this.element.closest(".replay");
    if (document.fullscreenElement) document.exitFullscreen();
    else box.requestFullscreen();
  }

  toggle() {
    if (this.clock.running) this.clock.pause();
    else this.clock.play();
    this.changed();
  }

  step(frames) {
    this.clock.step(frames);
    this.changed();
  }

  seek(time) {
    this.clock.seek(time);
    this.changed();
  }

  flip(name) {
    this.ticks[name].element.click();
  }

  lookFrom(name) {
    this.view.value = name;
    this.can.look(name);
  }

  changed() {
    this.show(true);
    this.onChange();
  }

  // Shows the clock's time; the words only with `told`.
  show(told) {
    const {clock} = this;
    this.bar.slider.value = clock.time;
    const words = clock.running ? "Pause" : "Play";
    if (this.play.textContent !== words) this.play.textContent = words;
    if (!told) return;
    this.time.textContent = `${number(clock.time, 2)} of ${seconds(clock.duration)}`;
    this.bar.slider.setAttribute("aria-valuetext", seconds(clock.time));
  }

  // Does what a key asks for; whether it asks for anything.
  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || this.steering.inert) return false;
    const inButton = event.target.matches?.("button, summary, a");
    if (event.target.matches?.("select, textarea, input:not([type=checkbox]):not([type=range])")) {
      return false;
    }
    // What scrolls by keys goes on to do so.
    if (event.key !== " " && event.target.closest?.(".scroll")) return false;
    if (event.key === " " && (inButton || event.target.matches?.("input"))) return false;
    const jump = (way) => (event.shiftKey ? this.seek(this.clock.time + way * JUMP_S)
      : this.step(way));
    const faster = (by) => {
      this.clock.faster(by);
      this.speed.value = String(this.clock.speed);
    };
    const acts = {" ": () => this.toggle(), ArrowLeft: () => jump(-1), ArrowRight: () => jump(1),
      Home: () => this.seek(0), End: () => this.seek(this.clock.duration),
      "<": () => faster(-1), ">": () => faster(1), a: () => this.can.turn(-10, 0, 1),
      d: () => this.can.turn(10, 0, 1), w: () => this.can.turn(0, 10, 1),
      s: () => this.can.turn(0, -10, 1), "+": () => this.can.turn(0, 0, 1.15),
      "-": () => this.can.turn(0, 0, 1 / 1.15), 0: () => this.lookFrom("start"),
      f: () => this.flip("follow"), m: () => this.flip("muscles"), c: () => this.flip("forces"),
      n: () => this.can.names && this.flip("names"),
      l: () => this.flip("loop"), x: () => this.fullScreen()};
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return false;
    act();
    this.onChange();
    return true;
  }
}

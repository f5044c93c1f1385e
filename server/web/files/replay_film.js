// A film of a replay, which the browser records while it plays from its start to its end.
import {h} from "./dom.js";
import {number} from "./format.js";
import {seconds} from "./replay_controls.js";
import {save} from "./sheet.js";

const SIZE = {width: 1280, height: 720};
const STRIP = 48;      // of its height, for words
const MARGIN = 20;
const BITS_PER_S = 8e6;
const STILL_MS = 600;  // of the end, before the film ends
const PIECE_MS = 1000;

// What this browser records, or null.
export function filmType() {
  if (typeof MediaRecorder === "undefined" || !HTMLCanvasElement.prototype.captureStream) return null;
  return ["video/webm;codecs=vp9", "video/webm", "video/mp4"].find((type) => MediaRecorder.isTypeSupported(type))
    ?? null;
}

export class Film {
  // `captions` has one for each view; `name` is the file's without its ending.
  constructor(clock, views, captions, name) {
    Object.assign(this, {clock, views, captions, name});
    this.bar = h("progress", {"aria-label": "Recorded"});
    this.words = h("span", null);
    this.cancel = h("button", {type: "button", onclick: () => this.end(false)}, "Cancel");
    this.element = h("p", {class: "row film", role: "group", "aria-label": "Film", hidden: true}, this.bar, this.words, this.cancel);
  }

  // Records, saves, and leaves the clock as it was, but at rest.
  async record() {
    const {clock, views} = this;
    const {time, speed, loop} = clock;
    this.element.hidden = false;
    this.cancel.focus();
    try {
      views.forEach((view) => view.holdSize({width: SIZE.width / views.length, height: SIZE.height}));
      Object.assign(clock, {time: 0, speed: 1, loop: false});
      views.forEach((view) => view.draw(0));
      const type = filmType();
      const pieces = await this.play(type);
      if (pieces) save(new Blob(pieces), `${this.name}.${/\w+/.exec(type.slice(6))[0]}`, type);
    } finally {
      clock.pause();
      Object.assign(clock, {time, speed, loop});
      views.forEach((view) => view.holdSize(null));
      this.element.hidden = true;
    }
  }

  // The parts of the film; null if the reader has cancelled it.
  async play(type) {
    const canvas = h("canvas", SIZE);
    this.context = canvas.getContext("2d");
    this.add();
    const stream = canvas.captureStream();
    const recorder = new MediaRecorder(stream, {mimeType: type, videoBitsPerSecond: BITS_PER_S});
    const pieces = [];
    recorder.addEventListener("dataavailable", ({data}) => pieces.push(data));
    // A tab that nobody sees draws nothing, and its film waits.
    const wait = () => {
      if (recorder.state !== "inactive") recorder[document.hidden ? "pause" : "resume"]();
    };
    document.addEventListener("visibilitychange", wait);
    const wanted = await new Promise((resolve) => {
      this.end = resolve;
      recorder.addEventListener("stop", () => resolve(false));  // by an error
      recorder.start(PIECE_MS);
      this.clock.play();
    });
    document.removeEventListener("visibilitychange", wait);
    if (recorder.state !== "inactive") {
      await new Promise((resolve) => {
        recorder.addEventListener("stop", resolve);
        recorder.stop();
      });
    }
    stream.getTracks().forEach((track) => track.stop());
    return wanted ? pieces : null;
  }

  // Puts what the views have just drawn into it.
  add() {
    if (this.element.hidden) return;
    const {clock, context, views} = this;
    const {height} = SIZE;
    const width = SIZE.width / views.length;
    views.forEach((view, place) => {
      context.drawImage(view.renderer.domElement, place * width, 0, width, height);
      context.fillStyle = "rgb(16 20 32 / 75%)";
      context.fillRect(place * width, height - STRIP, width, STRIP);
      Object.assign(context, {font: "500 22px system-ui, sans-serif", fillStyle: "#fff", textBaseline: "middle",
        textAlign: "left"});
      const last = place === views.length - 1;
      context.fillText(this.captions[place], place * width + MARGIN, height - STRIP / 2, width - (last ? 130 : 0) - 2 * MARGIN);
      if (!last) return;
      context.textAlign = "right";
      context.fillText(seconds(clock.time), SIZE.width - MARGIN, height - STRIP / 2);
    });
    this.bar.value = clock.time / clock.duration;
    const words = `The film is recorded as it plays: ${number(clock.time, 1)} of ${number(clock.duration, 1)} s`;
    if (this.words.textContent !== words) this.words.textContent = words;
    if (clock.ended) setTimeout(this.end, STILL_MS, true);
  }
}

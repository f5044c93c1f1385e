// Small pictures of episodes. The server makes them when they are asked for, so they may come late.
import {download} from "./api.js";
import {h} from "./dom.js";
import {visible, whole} from "./format.js";

const WIDTH = 320;
const HEIGHT = 180;
const MOST_BYTES = 1 << 20;

async function fill(canvas, words) {
  const leave = new AbortController();
  const {data} = await download(`${canvas.dataset.files}/picture.png`, {
    signal: leave.signal, most: MOST_BYTES, onWait: ({state, place}) => {
      if (!canvas.isConnected) leave.abort();
      words.textContent = state === "playing" || !place ? "The picture is being made."
        : `The picture is made after ${whole(place)} ${place === 1 ? "other" : "others"}.`;
    }});
  const image = await createImageBitmap(new Blob([data], {type: "image/png"}));
  canvas.getContext("2d").drawImage(image, 0, 0, WIDTH, HEIGHT);
  image.close();
  words.remove();
}

// Told when one comes into view: those that nobody looks at are not asked for.
const seen = new IntersectionObserver((entries) => {
  for (const {isIntersecting, target} of entries) {
    if (!isIntersecting) continue;
    seen.unobserve(target);
    const words = target.nextElementSibling;
    fill(target, words).catch((error) => {
      words.textContent = `There is no picture: ${visible(error.message)}`;
    });
  }
}, {rootMargin: "200px"});

// The picture of an episode, whose files are below the address `files` (filesOf in replays.js). `alt` says what
// it shows. It is a canvas, as an <img> can't send the reader's token.
export function picture(files, alt, caption = null) {
  const canvas = h("canvas", {width: WIDTH, height: HEIGHT, role: "img", "aria-label": alt,
    "data-files": files});
  seen.observe(canvas);
  return h("figure", {class: "picture"}, h("div", {class: "frame"}, canvas,
    h("p", {class: "quiet"}, "")), caption && h("figcaption", null, caption));
}

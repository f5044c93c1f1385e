// Small pictures of episodes. The server makes them when they are asked for, so they may come late.
import {h} from "./dom.js";
import {visible, whole} from "./format.js";
import {picture as load} from "./api.js";

const WIDTH = 320;
const HEIGHT = 180;
const LONGEST_MS = 10 * 60 * 1000;

const pause = (ms) => new Promise((resolve) => {
  setTimeout(resolve, ms);
});

async function fill(canvas, words) {
  const begin = performance.now();
  while (canvas.isConnected && performance.now() - begin < LONGEST_MS) {
    const answer = await load(`/v1/logs/${canvas.dataset.log}/picture.png`);
    if (answer.blob) {
      const image = await createImageBitmap(answer.blob);
      canvas.getContext("2d").drawImage(image, 0, 0, WIDTH, HEIGHT);
      image.close();
      canvas.classList.add("there");
      words.remove();
      return;
    }
    words.textContent = answer.state === "playing" ? "The picture is being made."
      : `The picture is made after ${whole(answer.place)} others.`;
    await pause(answer.retry_s * 1000);
  }
  words.textContent = "The picture takes long; open the page again later.";
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

// The picture of the episode with this log. `alt` says what it shows. It is a canvas, as an <img> can't
// send the reader's token.
export function picture(log, alt, caption = null) {
  const canvas = h("canvas", {width: WIDTH, height: HEIGHT, role: "img", "aria-label": alt,
    "data-log": log});
  seen.observe(canvas);
  return h("figure", {class: "picture"}, h("div", {class: "frame"}, canvas,
    h("p", {class: "quiet"}, "")), caption && h("figcaption", null, caption));
}

// Every page begins here: the bar at the top, and the part that the address asks for.
import {ApiError, keepToken, token, whoami} from "./api.js";
import {h, href, replace} from "./dom.js";
import {keepTimesCurrent, name, visible} from "./format.js";

const PAGES = {"/": "./boards.js", "/board": "./board.js", "/queue": "./queue.js",
  "/replay": "./replay.js", "/sign-in": "./sign_in.js", "/submission": "./submission.js",
  "/submit": "./submit.js", "/team": "./team.js"};

function showWho(who) {
  const box = document.getElementById("who");
  if (!token()) {
    const back = location.pathname === "/sign-in" ? "" : location.pathname + location.search;
    replace(box, who.role === "public" ? null : h("span", null, `${who.caller}, ${who.role}`),
      h("a", {href: href("/sign-in", {to: back})}, "Sign in"));
    return;
  }
  const teams = who.teams.length ? who.teams.map((team, place) => [place ? ", " : "", name(team)])
    : who.role;
  replace(box, h("span", null, teams), h("button", {type: "button", onclick: () => {
    keepToken(null);
    location.assign("/");
  }}, "Sign out"));
}

export function errorBox(error) {
  const signIn = error instanceof ApiError && (error.status === 401 || error.status === 403);
  return h("div", {class: "error", role: "alert"},
    h("p", null, visible(error.message)),
    signIn && h("p", null, h("a", {href: href("/sign-in",
      {to: location.pathname + location.search})}, "Sign in with a token")));
}

function markPage() {
  for (const link of document.querySelectorAll("nav[aria-label=Pages] a")) {
    const here = link.pathname === location.pathname
      || (link.pathname === "/" && location.pathname === "/board");
    if (here) link.setAttribute("aria-current", "page");
  }
}

async function show() {
  const main = document.getElementById("main");
  markPage();
  keepTimesCurrent();
  const who = whoami().then(showWho);
  try {
    const page = await import(PAGES[location.pathname]);
    await page.show(main, new URLSearchParams(location.search));
    await who;
  } catch (error) {
    main.querySelector(".loading")?.remove();
    if (!main.querySelector("h1")) main.prepend(h("h1", null, "This can't be shown"));
    main.append(errorBox(error));
    if (!(error instanceof ApiError)) throw error;
  } finally {
    performance.mark("shown");
    main.dataset.ready = "yes";
  }
}

show();

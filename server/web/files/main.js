// Every page begins here: the bar at the top, and the part that the address asks for.
import {ApiError, get, keepToken, pause, persist, token, tokenEnded, whoami} from "./api.js";
import {h, href, replace} from "./dom.js";
import {keepTimesCurrent, name, visible} from "./format.js";

const PAGES = {"/": "./boards.js", "/board": "./board.js", "/queue": "./queue.js",
  "/replay": "./replay.js", "/sign-in": "./sign_in.js", "/submission": "./submission.js",
  "/submit": "./submit.js", "/team": "./team.js"};

function showWho(who) {
  const box = document.getElementById("who");
  if (!token()) {
    const back = location.pathname === "/sign-in" ? "" : location.pathname + location.search;
    replace(box, tokenEnded() && h("span", {class: "ended", role: "status"},
      "Your token has expired or was revoked."),
    who.role === "public" ? null : h("span", null, `${who.caller}, ${who.role}`),
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

// Below the title, where it is seen.
function putError(main, error, more = null) {
  main.querySelector(".loading")?.remove();
  main.querySelector(".error.top-of-page")?.remove();
  if (!main.querySelector("h1")) main.prepend(h("h1", null, "This can't be shown"));
  const signIn = error instanceof ApiError && (error.status === 401 || error.status === 403);
  main.querySelector("h1").after(h("div", {class: "error top-of-page", role: "alert"},
    h("p", null, error.code === "no_token" ? "Sign in to see this." : visible(error.message)), more,
    signIn && h("p", null, h("a", {href: href("/sign-in",
      {to: location.pathname + location.search})}, "Sign in with a token"))));
}

function markPage() {
  for (const link of document.querySelectorAll("nav[aria-label=Pages] a")) {
    const here = link.pathname === location.pathname
      || (link.pathname === "/" && location.pathname === "/board");
    if (here) link.setAttribute("aria-current", "page");
  }
}

// The module of this page. What could not be loaded is not asked for again by every browser, so the page is.
async function load() {
  try {
    return await import(PAGES[location.pathname] ?? "./missing.js");
  } catch {
    await pause(5000);
    await get("/v1/live");
    location.reload();
    return new Promise(() => {});
  }
}

async function show() {
  const main = document.getElementById("main");
  markPage();
  keepTimesCurrent();
  const onTrouble = (error) => {
    if (error) putError(main, error, h("p", null, "It is asked again by itself."));
  };
  try {
    await persist(async () => {
      const who = whoami().then(showWho);
      const [page] = await Promise.all([load(), who]);
      await page.show(main, new URLSearchParams(location.search));
    }, onTrouble);
  } catch (error) {
    putError(main, error);
    if (!(error instanceof ApiError)) throw error;
  } finally {
    performance.mark("shown");
    main.dataset.ready = "yes";
  }
}

show();

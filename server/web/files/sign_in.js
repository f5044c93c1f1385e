// Signing in with a token, and out again.
import {errorOf, keepToken, token} from "./api.js";
import {h, replace} from "./dom.js";
import {visible} from "./format.js";

async function check(text) {
  const answer = await fetch("/v1/whoami", {headers: {Authorization: `Bearer ${text}`},
    credentials: "omit"});
  if (!answer.ok) throw errorOf(answer.status, await answer.json().catch(() => null));
}

// Where to go next: the address of a page of this server, whatever the query says. Its path is set and
// not parsed again: as a text, a path that begins with two slashes would be another server.
export function target(query) {
  const next = new URL("/", location.origin);
  let wanted = next;
  try {
    wanted = new URL(query.get("to") || "/", location.origin);
  } catch {
    // No address: the first page.
  }
  if (wanted.origin !== location.origin || wanted.protocol !== location.protocol) return next.href;
  next.pathname = wanted.pathname;
  next.search = wanted.search;
  next.hash = wanted.hash;
  return next.href;
}

export function show(main, query) {
  document.title = "Sign in – MyoGrade";
  const input = h("input", {id: "token", type: "password", autocomplete: "current-password",
    required: true, spellcheck: "false", "aria-describedby": "token-help"});
  const keep = h("input", {type: "checkbox", id: "keep"});
  const problem = h("p", {class: "problem", role: "alert"});
  const form = h("form", {class: "card narrow", onsubmit: async (event) => {
    event.preventDefault();
    const text = input.value.trim();
    replace(problem);
    try {
      if (!/^[!-~]+$/.test(text)) throw new Error("This is no token: it has other characters.");
      await check(text);
      keepToken(text, keep.checked);
      location.assign(target(query));
    } catch (error) {
      problem.textContent = visible(error.message);
      input.focus();
    }
  }},
  h("label", {for: "token"}, "Token"), input,
  h("p", {id: "token-help", class: "quiet"}, "Organisers make tokens, each for a team, with ",
    h("code", null, "myograde token create"), ". Yours is sent to this server only, and kept in this "
    + "tab until you close it or sign out."),
  h("p", null, h("label", {class: "inline", for: "keep"}, keep, " Keep me signed in on this computer"),
    h("span", {class: "quiet"}, "In all tabs, until you sign out. Not for a computer that you share.")),
  problem, h("button", {class: "main", type: "submit"}, token() ? "Use another token" : "Sign in"));
  replace(main, h("h1", null, "Sign in"), form);
  input.focus();
}

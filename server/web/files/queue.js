// What waits and what is played, as it changes.
import {follow} from "./api.js";
import {h, href, replace, table} from "./dom.js";
import {duration, name, state, time, visible, whole} from "./format.js";
import {liveBadge} from "./live.js";
import {phaseTitles} from "./places.js";

function progress(entry) {
  const {done, total} = entry.episodes;
  return [h("progress", {max: total, value: done, "aria-label": `${done} of ${total} episodes`}),
    h("span", {class: "quiet"}, ` ${whole(done)} of ${whole(total)}`)];
}

function wait(entry) {
  if (entry.state === "running" && !entry.waiting) return "";
  return entry.waiting ? visible(entry.waiting) : "is about to start";
}

const row = (titleOf) => (entry) => {
  return h("tr", null,
    h("td", {class: "num place"}, entry.queue ? entry.queue.position : "–"),
    h("th", {scope: "row"}, h("a", {href: href("/submission", {id: entry.submission})},
      name(entry.name || `submission ${entry.submission}`)),
    !entry.ranked && h("span", {class: "tag"}, "practice"),
    h("span", {class: "policy"}, name(entry.team), ", ", titleOf(entry))),
    h("td", null, state(entry.state)),
    h("td", null, progress(entry)),
    h("td", null, entry.estimated_end_at ? [time(entry.estimated_end_at),
      h("span", {class: "hidden"}, ` (${duration(entry.remaining_wall_s)})`)] : "–"),
    h("td", {class: "wide"}, wait(entry)));
};

function summary(view) {
  const status = {store: "The store can't be written: nothing starts.",
    paused: "This host plays nothing at the moment."}[view.status];
  return `${whole(view.running)} of ${whole(view.slots)} slots play, `
    + `${whole(view.pending_blocks)} blocks of episodes wait.${status ? ` ${status}` : ""}`;
}

export async function show(main) {
  document.title = "Queue – MyoGrade";
  const titleOf = await phaseTitles();
  const live = liveBadge();
  const line = h("p", {class: "lead", role: "status"});
  const box = h("div");
  const draw = (view, streams) => {
    live.on(streams ? "live" : "every 10 s");
    const text = summary(view);
    if (line.textContent !== text) line.textContent = text;
    replace(box, view.submissions.length
      ? table("Submissions that wait or are played",
        ["Place#", "Policy", "State", "Episodes", "Ends about", "Why it waits"],
        view.submissions.map(row(titleOf)))
      : h("p", {class: "empty"}, "Nothing of yours waits or is played."),
    view.total > view.submissions.length && h("p", {class: "quiet"},
      `${whole(view.total - view.submissions.length)} more wait behind these.`));
  };
  replace(main, h("h1", null, "Queue ", live.element), line, box);
  try {
    await follow("/v1/queue/events", "/v1/queue", draw, live.lost);
  } catch (error) {
    live.on(null);
    throw error;
  }
}

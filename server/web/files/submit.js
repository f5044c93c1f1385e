// Handing in a policy: an archive, or a folder or a program that is packed here.
import {ApiError, get, isOrganiser, post, upload, whoami} from "./api.js";
import {facts, h, href, replace} from "./dom.js";
import {bytes, dateTime, name, time, visible, whole} from "./format.js";
import {pack} from "./tar.js";

// What can be submitted to: phases that are open, and every track.
async function targets() {
  const [{tracks}, all] = await Promise.all([get("/v1/tracks"), get("/v1/challenges")]);
  const phases = all.challenges.flatMap((challenge) => challenge.phases);
  const withPhases = new Set(phases.map((phase) => phase.track));
  return [
    ...phases.filter((phase) => phase.state === "open").map((phase) => ({
      words: `${phase.title} (ranked, ${phase.episodes} episodes)`, closes: phase.closes_at,
      body: {phase: phase.phase, track: phase.track, profile: phase.profile}})),
    ...tracks.filter((track) => !withPhases.has(track.track)).map((track) => ({
      words: `${track.track}, ranked`, body: {track: track.track}})),
    ...tracks.map((track) => ({words: `${track.track}, practice`, practice: true,
      body: {track: track.track}})),
  ];
}

// All files below what was dropped; {path, file}, with paths relative to the folder.
async function filesBelow(entry, prefix) {
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => {
      entry.file(resolve, reject);
    });
    return [{path: prefix + entry.name, file}];
  }
  const reader = entry.createReader();
  const all = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => {
      reader.readEntries(resolve, reject);
    });
    if (!some.length) return all;
    for (const one of some) {
      all.push(...await filesBelow(one, one.isFile ? prefix : `${prefix}${one.name}/`));
    }
  }
}

// Whether a file begins as a program does: ELF, or a script that names what runs it.
async function isProgram(file) {
  const [a, b, c, d] = new Uint8Array(await file.slice(0, 4).arrayBuffer());
  return (a === 0x7f && b === 0x45 && c === 0x4c && d === 0x46) || (a === 0x23 && b === 0x21);
}

function manifestOf(program) {
  return new Blob([JSON.stringify({name: program, command: [`./${program}`]})]);
}

// What was chosen, as {words, blob}. An error says why it can't be submitted.
export async function parcelOf(files) {
  const single = files.length === 1 ? files[0] : null;
  if (single && /\.(tar|tar\.(gz|zst|xz|bz2)|tgz|tzst|txz|tbz2?|zip)$/i.test(single.path)) {
    return {words: `${single.path}, ${bytes(single.file.size)}`, blob: single.file};
  }
  if (single && await isProgram(single.file)) {
    const blob = pack([single, {path: "policy.json", file: manifestOf(single.path)}]);
    return {words: `the program ${single.path}, ${bytes(single.file.size)}`, blob};
  }
  if (!files.some((one) => one.path === "policy.json")) {
    throw new Error("There is no policy.json at the top of what you chose. Choose the folder that has "
      + "it, a program (ELF, or a script that begins with #!), or an archive (.tar, .tar.gz, .tgz, .tar.zst, .tzst, .tar.xz, .txz, .tar.bz2, .tbz2, .tbz, "
      + ".zip) of that folder's content.");
  }
  const blob = pack(files);
  return {words: `${whole(files.length)} files, ${bytes(blob.size)}`, blob};
}

function ofInput(input) {
  return [...input.files].map((file) => ({file, path: file.webkitRelativePath
    ? file.webkitRelativePath.split("/").slice(1).join("/") : file.name}));
}

async function ofDrop(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter((one) => one);
  const folder = entries.length === 1 && entries[0].isDirectory;
  const found = await Promise.all(entries.map((entry) => filesBelow(entry,
    folder || entry.isFile ? "" : `${entry.name}/`)));
  return found.flat();
}

const EMPTY = "Drop a folder, an archive or a program here";

function dropZone(onParcel, onProblem) {
  const chosen = h("p", {role: "status"}, EMPTY);
  const take = async (files) => {
    try {
      const parcel = await parcelOf(await files);
      chosen.textContent = `Chosen: ${visible(parcel.words)}`;
      onParcel(parcel);
    } catch (error) {
      chosen.textContent = EMPTY;
      onParcel(null);
      onProblem(error);
    }
  };
  const input = (id, words, more) => [
    h("input", {type: "file", id, class: "hidden", ...more,
      onchange: (event) => take(ofInput(event.target))}),
    h("label", {for: id, class: "button"}, words)];
  const zone = h("div", {class: "drop",
    ondragover: (event) => {
      event.preventDefault();
      zone.classList.add("over");
    },
    ondragleave: () => zone.classList.remove("over"),
    ondrop: (event) => {
      event.preventDefault();
      zone.classList.remove("over");
      take(ofDrop(event.dataTransfer));
    }},
  chosen, h("p", {class: "row"}, input("folder", "Choose a folder", {webkitdirectory: true}),
    input("archive", "Choose an archive or a program")));
  return zone;
}

function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) =>
    byte.toString(16).padStart(2, "0")).join("");
}

// Sent once more if its answer is lost: the key sees to it that it takes effect once.
async function submit(body) {
  const more = {"Idempotency-Key": newKey()};
  try {
    return await post("/v1/submissions", body, more);
  } catch (error) {
    if (error.status !== 0) throw error;
    return post("/v1/submissions", body, more);
  }
}

function done(box, artefact, answer) {
  const words = answer.linked ? "It was submitted before: this is its evaluation." : "It is submitted.";
  replace(box, h("div", {class: "card good", role: "status"}, h("h2", null, words),
    facts([["Policy", name(artefact.name)], ["Files", `${whole(artefact.files)}, `
      + bytes(artefact.bytes)], ["Submission", h("a", {href: href("/submission",
      {id: answer.submission})}, `${answer.submission}`)]]),
    h("p", null, h("a", {class: "button main", href: href("/submission", {id: answer.submission})},
      "Follow it"))));
}

function teamField(who) {
  if (who.teams.length && !isOrganiser(who)) {
    return h("select", {id: "team"}, who.teams.map((team) => h("option", {value: team},
      visible(team))));
  }
  const known = h("datalist", {id: "teams"});
  get("/v1/teams?limit=1000").then(({teams}) => known.append(...teams.filter((team) => !team.merged_into)
    .map((team) => h("option", {value: team.team}))), () => {});
  return [h("input", {id: "team", required: true, maxlength: 64, autocomplete: "off", list: "teams"}), known];
}

const limitWords = (budget) => {
  const left = Math.min(budget.per_day.left, budget.total.left);
  const most = budget.per_day.limit + budget.per_day.granted;
  return [h("b", null, whole(left)), ` of ${whole(most)} left today`, budget.total.left < most * 30
    ? `, ${whole(budget.total.left)} in all` : ""];
};

// What a team may still hand in for a target, and until when.
async function showLimits(box, team, wanted) {
  const asked = `${team} ${JSON.stringify(wanted.body)} ${wanted.practice}`;
  box.dataset.asked = asked;
  const closes = wanted.closes ? h("p", null, "Closes ", time(wanted.closes), ", ", dateTime(wanted.closes), ".")
    : null;
  const quota = team ? await get(`/v1/quota?${new URLSearchParams({team, limit: 1})}`).catch(() => null) : null;
  if (box.dataset.asked !== asked) return;  // something else was chosen meanwhile
  const {phase, track} = wanted.body;
  const entry = phase ? quota?.phases.find((one) => one.phase === phase)
    : quota?.tracks.find((one) => one.track === track);
  const budget = entry?.[wanted.practice ? "practice" : "official"];
  replace(box, budget && h("p", null, limitWords(budget), ". The next day begins ", time(quota.next_day_at), "."),
    closes);
}

export async function show(main) {
  document.title = "Submit – MyoGrade";
  const who = await whoami();
  if (who.role === "public") throw new ApiError(401, "no_token", "Sign in to submit a policy.");
  const all = await targets();
  const fields = [teamField(who)].flat();
  const [team] = fields;
  const target = h("select", {id: "target"}, all.map((one, place) =>
    h("option", {value: place}, visible(one.words))));
  const count = h("input", {id: "count", type: "number", min: 1, max: 10000, value: 10});
  const countBox = h("div", null, h("label", {for: "count"}, "Practice episodes"), count);
  const problem = h("p", {class: "problem", role: "alert"});
  const bar = h("progress", {max: 1, value: 0, hidden: true, "aria-label": "Upload"});
  const words = h("span", {role: "status"});
  const send = h("button", {class: "main", type: "submit", disabled: true}, "Submit");
  const limits = h("div", {class: "limits-left", role: "status"});
  const showTarget = () => {
    const wanted = all[target.value];
    countBox.hidden = !wanted?.practice;
    if (wanted) showLimits(limits, team.value, wanted);
  };
  target.addEventListener("change", showTarget);
  team.addEventListener("change", showTarget);
  showTarget();
  let parcel = null;
  const zone = dropZone((chosen) => {
    parcel = chosen;
    send.disabled = !chosen;
    replace(problem);
  }, (error) => {
    problem.textContent = visible(error.message);
  });
  const form = h("form", {class: "card", onsubmit: async (event) => {
    event.preventDefault();
    replace(problem);
    send.disabled = true;
    bar.hidden = false;
    const wanted = all[target.value];
    try {
      const at = new URLSearchParams({team: team.value, track: wanted.body.track});
      const artefact = await upload(`/v1/artefacts?${at}`, parcel.blob, (sent, size) => {
        bar.value = size ? sent / size : 0;
        words.textContent = sent < size ? `${bytes(sent)} of ${bytes(size)}`
          : "The server unpacks and checks it.";
      });
      const answer = await submit({...wanted.body, artefact: artefact.artefact, team: team.value,
        ...(wanted.practice ? {episodes: Number(count.value)} : {})});
      done(form.parentNode, artefact, answer);
    } catch (error) {
      problem.textContent = visible(error.message);
      bar.hidden = true;
      words.textContent = "";
      send.disabled = false;
    }
  }},
  h("div", {class: "fields"}, h("div", null, h("label", {for: "team"}, "Team"), fields),
    h("div", null, h("label", {for: "target"}, "For"), target), countBox), limits,
  zone, problem, h("p", {class: "row"}, send, bar, words));
  replace(main, h("h1", null, "Submit a policy"), h("p", {class: "lead"},
    "A policy is a folder with ", h("code", null, "policy.json"), " at its top, an archive of one, or "
    + "a single program. A folder is packed in this browser, with all of its files made executable; ", h("code", null, "myograde submit"),
    " keeps their modes."), h("div", null, form));
}

// The HTTP API, asked with the reader's own token, which is kept for this tab, or on this computer if the
// reader wishes.

const KEY = "myograde.token";
const ENDED = "myograde.ended";  // that a token was dropped, until the reader is told

export function token() {
  return sessionStorage.getItem(KEY) ?? localStorage.getItem(KEY);
}

export function keepToken(text, everywhere = false) {
  sessionStorage.removeItem(KEY);
  localStorage.removeItem(KEY);
  if (text) (everywhere ? localStorage : sessionStorage).setItem(KEY, text);
}

// Whether a token was not valid any more since this was asked last.
export function tokenEnded() {
  const ended = sessionStorage.getItem(ENDED) !== null;
  sessionStorage.removeItem(ENDED);
  return ended;
}

// An answer that tells of an error, or that there was none (status 0).
export class ApiError extends Error {
  constructor(status, code, message) {
    super(message);
    this.status = status;
    this.code = code;
  }
}

const LOST = "The server does not answer.";
const ANSWER_MS = 90000;

// Whether asking again later may help.
export function passes(error) {
  return error instanceof ApiError && (error.status === 0 || error.status === 429 || error.status >= 500);
}

// A signal that also ends what takes too long.
function deadline(signal, ms = ANSWER_MS) {
  const late = AbortSignal.timeout(ms);
  return signal ? AbortSignal.any([signal, late]) : late;
}

function headers(more = {}) {
  return token() ? {...more, Authorization: `Bearer ${token()}`} : more;
}

export function errorOf(status, body) {
  const error = body?.error ?? {code: "internal", message: `The server answered ${status}.`};
  return new ApiError(status, error.code, error.message);
}

// The value of a JSON text. Integers that a Number can't hold exactly, such as 63-bit seeds, become strings.
export function parseJson(text) {
  return JSON.parse(text.replace(/"(?:[^"\\]|\\.)*"|-?\d[-+.\deE]*/g,
    (token) => (/^-?\d+$/.test(token) && !Number.isSafeInteger(Number(token)) ? `"${token}"` : token)));
}

const jsonOf = (answer) => answer.text().then(parseJson).catch(() => null);

async function ask(method, path, {body, more, signal} = {}) {
  let answer;
  try {
    answer = await fetch(path, {method, headers: headers(more), signal: deadline(signal), credentials: "omit",
      body: body === undefined ? undefined : JSON.stringify(body)});
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ApiError(0, "lost", LOST);
  }
  const json = await jsonOf(answer);
  // A token that is not valid any more should not hide what is public.
  if (method === "GET" && json?.error?.code === "bad_token" && token()) {
    keepToken(null);
    sessionStorage.setItem(ENDED, "yes");
    return ask(method, path, {more, signal});
  }
  if (!answer.ok || json === null) throw errorOf(answer.status, json);
  return json;
}

export function get(path, signal) {
  return ask("GET", path, {signal});
}

export function post(path, body, more = {}) {
  return ask("POST", path, {body, more: {"Content-Type": "application/json", ...more}});
}

// How many s an answer asks to wait, within bounds.
function retryAfter(answer) {
  const asked = Number(answer.headers.get("Retry-After"));
  return Number.isFinite(asked) && asked > 0 ? Math.min(asked, 30) : 2;
}

function wait(seconds, signal) {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, 1000 * seconds);
    signal?.addEventListener("abort", () => {
      clearTimeout(timer);
      reject(signal.reason);
    }, {once: true});
  });
}

// The body of an answer, of at most so many bytes. onProgress(bytes, first part) is told of each part.
async function bodyOf(answer, most, onProgress) {
  const parts = [];
  let received = 0;
  const reader = answer.body.getReader();
  for (;;) {
    const {value, done} = await reader.read();
    if (done) break;
    received += value.length;
    if (received > most) {
      await reader.cancel();
      throw new ApiError(0, "too_large", `The server sent more than ${most} bytes.`);
    }
    parts.push(value);
    onProgress(received, parts[0]);
  }
  return new Blob(parts).arrayBuffer();
}

const MOST_WAIT_MS = 1800000;

// A file, which the server may have to make first: until then onWait({state, place}) is told how that
// stands, and while it arrives onProgress (bodyOf). `received`: how many bytes came over the network, as far as the browser tells.
export async function download(path, {signal, most, onWait = () => {}, onProgress = () => {}}) {
  const begin = performance.now();
  for (;;) {
    let data;
    try {
      const answer = await fetch(path, {headers: headers(), signal, credentials: "omit"});
      if (answer.status === 202 || answer.status === 503) {
        const body = await jsonOf(answer);
        if (performance.now() - begin > MOST_WAIT_MS) {
          throw new ApiError(0, "deadline", "It was not made within half an hour: try again later.");
        }
        if (answer.status === 503 && body?.error?.code !== "busy") throw errorOf(503, body);
        onWait(body?.state ? body : {state: "waiting", place: 0});
        await wait(retryAfter(answer), signal);
        continue;
      }
      if (!answer.ok) throw errorOf(answer.status, await jsonOf(answer));
      data = await bodyOf(answer, most, onProgress);
    } catch (error) {
      if (error instanceof ApiError || error.name === "AbortError") throw error;
      throw new ApiError(0, "lost", LOST);
    }
    const sizes = performance.getEntriesByName(new URL(path, location.href).href).at(-1);
    return {data, received: sizes?.encodedBodySize || data.byteLength};
  }
}

let me = null;

// Who the server takes the reader for.
export function whoami() {
  me ??= get("/v1/whoami").catch((error) => {
    me = null;  // asked again
    throw error;
  });
  return me;
}

export function isOrganiser(who) {
  return who.role === "organiser" || who.role === "operator";
}

// Sends a file and tells of its progress: progress(sent bytes, all bytes).
export function upload(path, blob, progress, signal) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    for (const [name, value] of Object.entries(headers({"Content-Type": "application/x-tar"}))) {
      request.setRequestHeader(name, value);
    }
    request.upload.addEventListener("progress", (event) => progress(event.loaded, event.total));
    request.addEventListener("load", () => {
      let body = null;
      try {
        body = parseJson(request.responseText);
      } catch {
        // Not JSON: the status says enough.
      }
      if (request.status < 400 && body) resolve(body);
      else reject(errorOf(request.status, body));
    });
    request.addEventListener("error", () => reject(new ApiError(0, "lost", LOST)));
    request.addEventListener("abort", () => reject(new ApiError(0, "aborted", "Cancelled.")));
    signal?.addEventListener("abort", () => request.abort());
    request.send(blob);
  });
}

const SILENT_MS = 30000;  // events come every 10 s

// Reads server-sent events until the stream ends or is silent. EventSource would do, but sends no token.
async function readEvents(path, onEvent) {
  const silence = new AbortController();
  let timer = setTimeout(() => silence.abort(), SILENT_MS);
  const {signal} = silence;
  const answer = await fetch(path, {headers: headers(), credentials: "omit", signal});
  if (!answer.ok) throw errorOf(answer.status, await jsonOf(answer));
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const {value, done} = await reader.read();
    clearTimeout(timer);
    if (done) return;
    timer = setTimeout(() => silence.abort(), SILENT_MS);
    const events = (rest + value).split("\n\n");
    rest = events.pop();
    for (const event of events) {
      const data = event.split("\n").filter((line) => line.startsWith("data: "))
        .map((line) => line.slice(6)).join("\n");
      if (data) onEvent(parseJson(data));
    }
  }
}

const RETRY_MS = 2000;
const POLL_MS = 10000;
const LONGEST_MS = 15000;
const POLLS = 6;  // in a row, before a stream is tried again

export const pause = (ms) => new Promise((resolve) => {
  setTimeout(resolve, ms * (0.8 + 0.4 * Math.random()));
});

// How long to wait after so many failures in a row.
const backOff = (failures) => Math.min(RETRY_MS * 2 ** Math.min(failures - 1, 10), LONGEST_MS);

// What `make` gives, once it succeeds: after errors that may pass it is called again, later and later. Each is
// told to onTrouble(error), and null at the end.
export async function persist(make, onTrouble) {
  for (let failures = 1; ; failures += 1) {
    try {
      const made = await make();
      onTrouble(null);
      return made;
    } catch (error) {
      if (!passes(error)) throw error;
      onTrouble(error);
      await pause(backOff(failures));
    }
  }
}

// Follows `events`: onState(state, streams). Where streams don't come through or end early, asks `address` now
// and then, and tries a stream again later. onTrouble(error): nothing comes at present. Ends with the page, or
// with an error that asking again won't mend.
export async function follow(events, address, onState, onTrouble) {
  let short = 0;     // streams in a row that ended early
  let failures = 0;  // in a row
  for (let polls = 0; ;) {
    const begin = performance.now();
    const streams = short < 3;
    const take = (state) => {
      failures = 0;
      onState(state, streams);
    };
    try {
      if (streams) {
        await readEvents(events, take);
        short = performance.now() - begin > SILENT_MS ? 0 : short + 1;
      } else {
        take(await get(address));
        polls += 1;
        if (polls % POLLS === 0) short = 0;
      }
    } catch (error) {
      if (error instanceof ApiError && !passes(error)) throw error;
      failures += 1;
      onTrouble(error);
    }
    if (failures) await pause(backOff(failures));
    else await pause(short < 3 ? RETRY_MS : POLL_MS);
  }
}

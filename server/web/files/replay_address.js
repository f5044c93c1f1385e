// What of a replay stands in its address besides the episodes, so that a moment can be shared: the time, and from
// where one looks at it, as in #t=1.52&camera=90,-10,2.4.

const KEEP_MS = 400;

function numbers(text, count) {
  const all = (text ?? "").split(",").map(Number);
  return text && all.length === count && all.every(Number.isFinite) ? all : null;
}

// {time, camera} of the address; null where it says nothing of one, or nonsense.
export function momentAsked() {
  const asked = new URLSearchParams(location.hash.slice(1));
  return {time: numbers(asked.get("t"), 1)?.[0] ?? null, camera: numbers(asked.get("camera"), 3)};
}

// A function that is to be called when something of it has changed, and puts it into the address.
export function keepMoment(clock, views) {
  let timer = null;
  const write = () => {
    timer = null;
    if (clock.running) return;
    const camera = views[0]?.angles().map((part) => Number(part.toFixed(2))).join(",");
    const parts = [`t=${Number(clock.time.toFixed(3))}`, ...(camera ? [`camera=${camera}`] : [])];
    history.replaceState(null, "", `${location.pathname}${location.search}#${parts.join("&")}`);
  };
  return () => {
    timer ??= setTimeout(write, KEEP_MS);
  };
}

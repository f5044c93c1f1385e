#!/usr/bin/python3
"""Makes the two pictures of README.md, board.png and replay.png, beside this file: the demo's warm-up
board, and the replay of an episode of a baseline, as a headless Chromium shows them.

Use: ./dev build && server/docs/pictures.py TRACK [BUILD]   (the warm-up's name; default: build/release;
needs Debian's chromium and python3-pil). A machine with other fonts gives other pixels, and nothing compares them."""

import io
import json
import pathlib
import shutil
import sys

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[1]
sys.path.insert(0, str(SOURCE / "tests"))

from PIL import Image  # noqa: E402
from support.browser import Browser, Page  # noqa: E402
from support.daemon import Daemon  # noqa: E402

MOST_BYTES = 200_000
PLAY_S = 1200
DRAWN = ("document.querySelector('.canvas') && "
         "document.getElementById('main')?.dataset.ready === 'yes'")


def submit(daemon, policy, track, team):
    return json.loads(daemon.run_verb("submit", policy, "--track", track, "--team", team, "--wait",
                                      "--json", "--data", daemon.data, timeout_s=PLAY_S,
                                      text=True).stdout)["submission"]


def play(daemon, policies, track):
    """The demo's submissions to its warm-up, and a baseline's, whose number is returned."""
    gentle = daemon.root / "gentle"
    scripted = policies / f"scripted-{track}"
    shutil.copytree(scripted, gentle)
    (gentle / "policy.json").write_text(json.dumps(
        {"name": f"gentle-{track}", "command": [f"./{scripted.name}", "--stiffness", "10"]}))
    for policy, team in ((policies / "random", "Random team"), (gentle, "Gentle team"),
                         (scripted, "Scripted team")):
        submit(daemon, policy, track, team)
    demo = sorted((daemon.configs / "tracks").glob("demo-*.json"))[0].stem
    return submit(daemon, policies / demo.replace("demo", "baseline"), demo, "Baseline team")


def save(page, name, height):
    """Writes what the page shows, in few enough colours for its size."""
    page.screenshot(HERE / name)
    picture = Image.open(io.BytesIO((HERE / name).read_bytes())).convert("RGB")
    picture = picture.crop((0, 0, picture.width, min(picture.height, height)))
    for colours in (256, 128, 64, 32):
        packed = io.BytesIO()
        picture.quantize(colours).save(packed, "PNG", optimize=True)
        if len(packed.getvalue()) <= MOST_BYTES:
            break
    (HERE / name).write_bytes(packed.getvalue())
    print(f"{name}: {picture.width}x{picture.height}, {len(packed.getvalue())} bytes")


def main():
    track = sys.argv[1]
    build = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else SOURCE / "build/release").resolve()
    with Daemon(build / "bin", SOURCE, "pictures") as daemon:
        daemon.configure(http={"listen": {"address": "127.0.0.1", "port": 0}})
        daemon.start()
        played = play(daemon, build / "policies", track)
        token = daemon.post("/v1/tokens", {"role": "organiser", "label": "pictures"})["token"]
        url = (daemon.data / "listen").read_text(encoding="utf-8").strip()
        rows = daemon.get(f"/v1/submissions/{played}/result?episodes=1")["episode_rows"]
        log = next(row["log"]["sha256"] for row in rows if row.get("log"))
        with Browser() as browser:
            page = Page(browser, width=1100, height=760)
            # A replay that stands is drawn in full, however slow this machine is.
            page.call("Emulation.setEmulatedMedia",
                      features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
            page.open(url + "/sign-in")
            page.evaluate(f"sessionStorage.setItem('myograde.token', {json.dumps(token)})")
            page.open(f"{url}/board?track={track}")
            save(page, "board.png", 560)
            page.open(f"{url}/replay?log={log}&of={played}", DRAWN)
            page.evaluate("(() => { const bar = document.querySelector('.timebar input');"
                          "bar.value = bar.max * 0.4; bar.dispatchEvent(new Event('input')); })()")
            page.evaluate("new Promise((done) => setTimeout(done, 3000))")
            save(page, "replay.png", 900)


if __name__ == "__main__":
    main()

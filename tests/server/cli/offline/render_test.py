"""Films and pictures of episodes: what is written, and that a mistake of any kind leaves no file.
The shipped reference logs are drawn. Films are encoded by ffmpeg where it is installed.
usage: render_test.py BIN_DIR SOURCE_DIR"""
import hashlib
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
import cli_case  # pylint: disable=wrong-import-position
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, RESULT, SOURCE_DIR, CliCase, Handler, myograde, validate)

cli_case.SECONDS = 250  # drawing has a low priority
LOG = f"{SOURCE_DIR}/configs/reference/elbow.lcmlog.zst"
SMALL = ("--size", "64x48")
PNG = b"\x89PNG\r\n\x1a\n"
FFMPEG = shutil.which("ffmpeg")
# Keeps the pictures as they come.
FAKE_ENCODER = """#!/bin/sh
for last; do :; done
cat > "${last#file:}"
echo frame=3
"""


def png_size(path):
    with open(path, "rb") as file:
        head = file.read(24)
    assert head[:8] == PNG, head
    return struct.unpack(">II", head[16:24])


class Render(CliCase):
    def out(self, name):
        folder = self.path(f"out{len(os.listdir(self.temp))}")
        os.mkdir(folder)
        return f"{folder}/{name}"

    def nothing_left(self, file):
        self.assertEqual(os.listdir(os.path.dirname(file)), [])

    def program(self, name, text):
        return os.path.dirname(self.path(f"programs/{name}", text, mode=0o755))

    def drawn(self, *words, **env):
        done = myograde("episode", "render", *words, "--json", **env)
        self.assertEqual(done.returncode, 0, done.stderr)
        value = json.loads(done.stdout)
        validate(value, "render")
        with open(value["file"], "rb") as file:
            content = file.read()
        self.assertEqual(value["sha256"], hashlib.sha256(content).hexdigest())
        self.assertEqual(value["bytes"], len(content))
        return value, content

    def test_a_picture_is_a_png_with_the_same_bytes_each_time(self):
        first = self.out("a.png")
        value, content = self.drawn(LOG, "-o", first, *SMALL)
        self.assertEqual(png_size(first), (64, 48))
        self.assertEqual((value["form"], value["frames"], value["seconds"]), ("picture", 1, None))
        self.assertEqual(value["episodes"], [{"index": 0, "place": None, "steps": 50,
                                              "verdict": None}])
        self.assertEqual(os.stat(first).st_mode & 0o111, 0)
        self.assertEqual(self.drawn(LOG, "-o", self.out("b.PNG"), *SMALL)[1], content)
        self.assertNotEqual(self.drawn(LOG, "-o", first, "--at", "0.1", "--no-overlay", *SMALL)[1],
                            content)

    def test_a_film_is_what_was_drawn_at_its_speed(self):
        path = f"{self.program('ffmpeg', FAKE_ENCODER)}:/usr/bin:/bin"
        value, content = self.drawn(LOG, "-o", self.out("a.mp4"), *SMALL, "--speed", "4", PATH=path)
        # 50 steps of 0.02 s in a quarter of their time, and the last state for 1.5 s.
        self.assertEqual(value["frames"], 54)
        self.assertAlmostEqual(value["seconds"], 54 / 30)
        self.assertEqual(len(content), 54 * 64 * 48 * 3)

    @unittest.skipUnless(FFMPEG and shutil.which("ffprobe"), "ffmpeg is not installed")
    def test_films_are_mp4_and_webm(self):
        for name, codec in (("a.mp4", "h264"), ("a.webm", "vp9")):
            file = self.out(name)
            _, content = self.drawn(LOG, "-o", file, *SMALL, "--speed", "4")
            probe = subprocess.run(
                ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json", file],
                capture_output=True, check=True, timeout=cli_case.SECONDS)
            stream = json.loads(probe.stdout)["streams"][0]
            self.assertEqual((stream["codec_name"], stream["width"], stream["height"],
                              stream["pix_fmt"], stream["nb_read_frames"], stream["r_frame_rate"]),
                             (codec, 64, 48, "yuv420p", "54", "30/1"))
            self.assertEqual(os.listdir(os.path.dirname(file)), [name])
        self.assertEqual(content, self.drawn(LOG, "-o", file, *SMALL, "--speed", "4")[1])

    def test_films_without_or_with_a_broken_ffmpeg_are_told_in_a_sentence(self):
        file = self.out("a.mp4")
        self.refused(4, "ffmpeg is not installed: install it", "episode", "render", LOG, "-o", file, *SMALL,
                     PATH="/nowhere")
        broken = self.program("ffmpeg", "#!/bin/sh\nhead -c 1 >/dev/null\n"
                              "echo 'no such codec' >&2\nexit 3\n")
        self.refused(4, "ffmpeg can't encode the film: no such codec", "episode", "render", LOG, "-o", file,
                     *SMALL, PATH=f"{broken}:/usr/bin:/bin")
        self.nothing_left(file)

    def test_a_log_that_cannot_be_shown_leaves_no_file(self):
        with open(LOG, "rb") as log:
            content = log.read()
        path = self.path("cut.lcmlog.zst")
        with open(path, "wb") as cut:
            cut.write(content[:-3])
        file = self.out("a.png")
        self.refused(1, "cut", "episode", "render", path, "-o", file)
        self.refused(2, "nowhere.lcmlog", "episode", "render", self.path("nowhere.lcmlog"), "-o", file)
        self.nothing_left(file)

    def test_a_renderer_that_fails_is_told_and_its_pictures_are_thrown_away(self):
        for script, status, sentence in (
                ("echo half; echo 'myograde-render: no OSMesa' >&2; exit 1", 4,
                 "can't draw a picture: no OSMesa"),
                ("echo half; echo 'myograde-render: episode 0 differs' >&2; exit 3", 1,
                 "episode 0 differs"),
                ("kill -SYS $$", 4, "Bad system call"),
                ("kill -ALRM $$", 4, "took longer than 600 s")):
            folder = self.program("myograde-render", f"#!/bin/sh\ncat >/dev/null\n{script}\n")
            file = self.out("a.png")
            self.refused(status, sentence, "episode", "render", LOG, "-o", file, MYOGRADE_BIN_DIR=folder)
            self.nothing_left(file)

    def test_an_interrupt_ends_the_programs_and_leaves_nothing(self):
        pid = self.path("pid")
        folder = self.program("myograde-render", f"#!/bin/sh\necho $$ > {pid}\nexec sleep 1000\n")
        file = self.out("a.png")
        temp = self.path("tmp")
        os.mkdir(temp)
        process = subprocess.Popen(
            [f"{BIN_DIR}/myograde", "episode", "render", LOG, "-o", file], stderr=subprocess.PIPE, text=True,
            env={**os.environ, "MYOGRADE_BIN_DIR": folder, "TMPDIR": temp})
        for _ in range(1000):
            if os.path.exists(pid) and os.path.getsize(pid) > 1:
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=cli_case.SECONDS)
        self.assertEqual(process.returncode, 4, said)
        self.assertIn("interrupted", said)
        self.nothing_left(file)
        self.assertEqual(os.listdir(temp), [])
        with open(pid, encoding="utf-8") as text, self.assertRaises(ProcessLookupError):
            os.kill(int(text.read()), 0)

    def test_options_that_do_not_fit_are_refused_before_any_work(self):
        for sentence, *words in (
                (".mp4, .webm or .png", LOG, "-o", "a.gif"),
                ("must end in", LOG, "-o", "png"),
                ("write WIDTHxHEIGHT", LOG, "-o", "a.png", "--size", "large"),
                ("write WIDTHxHEIGHT", LOG, "-o", "a.png", "--size", "8x5000"),
                ("must be even", LOG, "-o", "a.mp4", "--size", "65x48"),
                ("--at", LOG, "-o", "a.mp4", "--at", "1"),
                ("--speed", LOG, "-o", "a.png", "--speed", "2"),
                ("--speed", LOG, "-o", "a.mp4", "--speed", "0"),
                ("a strip is a picture", "7", "--strip", "-o", "a.mp4"),
                ("leave --episode out", "7", "--strip", "--episode", "1", "-o", "a.png"),
                ("name the episode", "7", "-o", "a.png"),
                ("holds one episode", LOG, "--episode", "0", "-o", "a.png"),
                ("can't be written", LOG, "-o", "/nowhere/a.png")):
            self.refused(2, sentence, "episode", "render", *words)

    def rows(self, config, outcome="success"):
        with open(LOG, "rb") as file:
            packed = file.read()
        unpacked = subprocess.run(["zstd", "-dcq", LOG], capture_output=True, check=True).stdout
        digest = hashlib.sha256(unpacked).hexdigest()
        log = {"sha256": digest, "bytes": len(unpacked), "packed_bytes": len(packed), "steps": 50}
        row = {"index": 0, "outcome": outcome, "reason": "", "steps": 50, "log": log, "facts": {},
               "metrics": {"success": 1, "time_s": 1.0, "effort": 0.1}}
        lost = {**row, "index": 1, "log": None}
        result = {**RESULT, "hashes": {"config": config}, "episode_rows": [row, lost]}
        return {"GET /v1/submissions/7/result?episodes=1": (200, result),
                f"GET /v1/logs/{digest}": (200, packed.decode("latin-1"))}

    def of_submission(self, *words, **changes):
        head = subprocess.run(["zstd", "-dcq", LOG], capture_output=True, check=True).stdout
        header, _ = json.JSONDecoder().raw_decode(head[head.index(b"{"):].decode("latin-1"))
        answers = self.rows(changes.get("config", header["config"]), changes.get("outcome"))
        return [*words, "--socket", self.serve(answers)]

    def test_an_episode_of_a_submission_has_its_verdict(self):
        value, _ = self.drawn(*self.of_submission("7", "--episode", "0", "-o", self.out("a.png"),
                                                  *SMALL, outcome="success"))
        self.assertEqual(value["submission"], 7)
        self.assertEqual(value["episodes"][0]["verdict"], "success")

    def test_a_strip_of_a_log_has_one_row(self):
        file = self.out("a.png")
        value, _ = self.drawn(LOG, "--strip", "-o", file, *SMALL)
        self.assertEqual((value["form"], [one["place"] for one in value["episodes"]]), ("strip", ["only"]))
        self.assertEqual(png_size(file), (5 * (64 + 4) - 4, 48))

    def test_a_strip_picks_from_the_episodes_that_have_a_log(self):
        file = self.out("a.png")
        value, _ = self.drawn(*self.of_submission("7", "--strip", "-o", file, *SMALL,
                                                  outcome="success"))
        self.assertEqual([(e["index"], e["place"]) for e in value["episodes"]], [(0, "only")])
        self.assertEqual(png_size(file), (5 * 64 + 4 * 4, 48))

    def test_what_a_submission_does_not_have_is_told(self):
        file = self.out("a.png")
        for status, sentence, words, changes in (
                (2, "no recorded episode 9", ("--episode", "9"), {}),
                (2, "the log of episode 1 was not kept", ("--episode", "1"), {}),
                (2, "withholds", ("--strip",), {"outcome": None}),
                (1, "another episode or config", ("--episode", "0"), {"config": "e" * 64})):
            self.refused(status, sentence, "episode", "render",
                         *self.of_submission("7", *words, "-o", file, **changes))
            os.remove(self.path("sock"))
        self.nothing_left(file)


# Sends text as the bytes that its characters are.
def reply(self):
    self.heard.append((self.command, self.path, self.body()))
    status, answer = self.answers.get(f"{self.command} {self.path}", (404, {
        "error": {"code": "not_found", "message": "There is no such thing."}}))
    data = answer.encode("latin-1") if isinstance(answer, str) else json.dumps(answer).encode()
    self.send_response(status)
    self.send_header("Content-Length", str(len(data)))
    self.end_headers()
    self.wfile.write(data)


if __name__ == "__main__":
    Handler.do_GET = reply
    unittest.main(argv=sys.argv[:1])

"""Trajectory and model files as sim/trajectory/README.md describes them, made of plain numbers: what the
pages are tested with where no simulator runs."""

import json
import math
import struct

MAGIC = b"MYOTRAJ1"
MODEL = "0123456789abcdef"
PERIOD = 0.02  # s
ROWS, COLUMNS = 120, 12  # of the terrain


def packed(numbers, kind):
    """Whole numbers (lists, one for each channel) as an array of the file."""
    modulus = 1 << (16 if kind == "u16" else 8)
    coded = []
    for channel in numbers:
        before = 0
        for number in channel:
            step = (number - before) % modulus
            if step >= modulus // 2:
                step -= modulus
            coded.append(2 * step if step >= 0 else -2 * step - 1)
            before = number
    if kind == "u8":
        return bytes(coded)
    return bytes(one & 255 for one in coded) + bytes(one >> 8 for one in coded)


def array(values, kind, low=None, high=None):
    """(entry of the head, bytes) of an array of values: lists, one for each channel. Without bounds each
    channel has its own."""
    most = 65535 if kind == "u16" else 255
    lows = [min(channel) if low is None else low for channel in values]
    highs = [max(channel) if high is None else high for channel in values]
    numbers = [[round((one - l) / (h - l) * most) if h > l else 0 for one in channel]
               for channel, l, h in zip(values, lows, highs)]
    head = {"type": kind, "channels": len(values), "length": len(values[0]) if values else 0,
            "low": lows if low is None else low, "high": highs if high is None else high}
    return head, packed(numbers, kind)


def written(head, arrays):
    """A whole file."""
    offset, parts, entries = 0, [], {}
    for name, (entry, data) in arrays.items():
        entries[name] = {"offset": offset, "bytes": len(data), **entry}
        parts.append(data)
        offset += len(data)
    text = json.dumps({**head, "arrays": entries}, ensure_ascii=False).encode()
    return MAGIC + struct.pack("<I", len(text)) + text + b"".join(parts)


class Walk:
    """An episode in which a block ("root") with an arm ("arm") walks along y and turns, moved by two
    muscles: what it is at each frame."""

    def __init__(self, seconds):
        self.seconds = seconds
        self.frames = round(seconds / PERIOD) + 1
        times = [frame * PERIOD for frame in range(self.frames)]
        still = [0.0] * self.frames
        self.position = [[0.1 * math.sin(t) for t in times], [-1.2 * t for t in times],
                         [1 + 0.05 * math.sin(9 * t) for t in times], still, still,
                         [0.3] * self.frames]
        turn, swing = [math.sin(t) / 2 for t in times], [math.sin(6 * t) / 2 for t in times]
        self.rotation = [[math.cos(a) for a in turn], still, still, [math.sin(a) for a in turn],
                         [math.cos(a) for a in swing], [math.sin(a) for a in swing], still, still]
        self.activation = [[0.5 + 0.5 * math.sin(6 * t) for t in times],
                           [0.5 - 0.5 * math.sin(6 * t) for t in times]]
        self.wrapped = [frame // 50 % 2 for frame in range(self.frames)]
        self.counts = [2 if frame % 20 < 8 else 0 for frame in range(self.frames)]
        self.distance = [1.2 * t for t in times]
        self.speed = [1.2 + 0.2 * math.sin(3 * t) for t in times]
        self.states = [frame // 30 % 4 for frame in range(self.frames)]
        self.heights = [[0.15 * max(0.0, math.sin(row / 6)) for _ in range(COLUMNS)]
                        for row in range(ROWS)]
        self.strongest = math.hypot(20, 800)

    def contacts(self):
        places = [self.position[1][frame] for frame in range(self.frames)
                  for _ in range(self.counts[frame])]
        count = len(places)
        return [[0.05 * (i % 2) for i in range(count)], places, [0.01] * count, [20.0] * count,
                [0.0] * count, [400.0 + 100 * (i % 5) for i in range(count)]]

    def touching(self):
        """The root on the ground, then the arm on the root."""
        count = sum(self.counts)
        return [[1 + i % 2 for i in range(count)], [i % 2 for i in range(count)]]

    def arrays(self):
        numbers = [[round((value - min(one)) / (max(one) - min(one)) * 65535) for value in one]
                   for one in (self.distance, self.speed)] + [self.states]
        series = {"type": "u16", "channels": 3, "length": self.frames,
                  "low": [min(self.distance), min(self.speed), 0],
                  "high": [max(self.distance), max(self.speed), 65535]}
        wrap = {"type": "u8", "channels": 7, "length": self.frames, "low": [0] + [0.1] * 6,
                "high": [255] + [0.2] * 6}
        return {
            "position": array(self.position, "u16"),
            "rotation": array(self.rotation, "u16", -1, 1),
            "activation": array(self.activation, "u8", 0, 1),
            "wrap": (wrap, packed([self.wrapped, *([0] * self.frames for _ in range(6))], "u8")),
            "contact_count": array([self.counts], "u8", 0, 255),
            "contact": array(self.contacts(), "u16"),
            "contact_body": array(self.touching(), "u16", 0, 65535), "series": (series, packed(numbers, "u16")),
            "terrain": array(self.heights, "u16", 0, 0.2)}


def walk(seconds=8.0, end="fell", events=(), **more):
    """The file of a Walk; `more` are keys of its head."""
    made = Walk(seconds)
    head = {"format": 1, "track": "locomotion", "model": MODEL, "episode": 37, "end": end,
            "steps": 2 * (made.frames - 1), "duration_s": seconds, "period_s": PERIOD,
            "frames": made.frames, "bodies": [{"name": "root"}, {"name": "arm", "from": 0}],
            "muscles": ["flexor", "extensor"], "wraps": 1,
            "series": [{"name": "distance", "title": "Distance", "unit": "m"},
                       {"name": "speed", "title": "Speed", "unit": "m/s"},
                       {"name": "leg_state", "title": "State of the leg", "unit": "",
                        "labels": ["early stance", "late stance", "early swing", "late swing"]}],
            "events": [*events, {"time_s": 0.6, "kind": "leg_state", "text": "late stance"},
                       {"time_s": 3.2, "kind": "peak_force", "text": "the largest force",
                        "value": 800.0, "unit": "N"},
                       {"time_s": seconds, "kind": "end", "text": end}],
            "terrain": {"rows": ROWS, "columns": COLUMNS, "low": [-1.5, -12], "high": [1.5, 2]}}
    return written({**head, **more}, made.arrays())


CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
         (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]


def glb(model=MODEL, track="locomotion"):
    """A model file for walk(): two blocks."""
    points = b"".join(struct.pack("<fff", *corner) for corner in CORNERS)
    faces = b"".join(struct.pack("<HHH", *face) for face in FACES)
    data = points + faces
    extras = {"format": 1, "track": track, "model": model,
              "camera": {"body": "root", "look_at": [0, 0, -0.4], "distance_m": 4.5,
                         "azimuth_deg": 150, "elevation_deg": -15},
              "muscles": [{"name": "flexor", "radius_m": 0.02, "path": [
                               {"body": "root", "at": [0.2, 0, 0.2]}, {"wrap": 0, "body": "arm"},
                               {"body": "arm", "at": [0.1, 0, 0.5]}]},
                          {"name": "extensor", "radius_m": 0.02, "path": [
                              {"body": "root", "at": [-0.2, 0, 0.2]},
                              {"body": "arm", "at": [-0.1, 0, 0.5]}]}],
              "floor": {"height_m": 0, "half_size_m": [5, 5], "square_m": 1}}
    def body(name, at, half, child):
        return [{"name": name, "translation": at, "children": [child]},
                {"mesh": 0, "scale": half}]
    gltf = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0], "extras": extras}],
        "nodes": [{"name": "world", "rotation": [-0.7071068, 0, 0, 0.7071068], "children": [1, 3]},
                  *body("root", [0, 0, 1], [0.2, 0.15, 0.3], 2),
                  *body("arm", [0, 0, 1.3], [0.08, 0.08, 0.5], 4)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.75, 0.6, 1],
                                                "metallicFactor": 0}}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
                       "min": [-1, -1, -1], "max": [1, 1, 1]},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
                        {"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)}],
        "buffers": [{"byteLength": len(data)}]}
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    return (struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data))
            + struct.pack("<I4s", len(text), b"JSON") + text
            + struct.pack("<I4s", len(data), b"BIN\0") + data)

"""Prints all that it can see: arguments, environment, messages, and every file that it can read.
Looks in all of it for what it must not know. `needles.bin` beside it holds that, each byte flipped,
so that the file itself is none of the places where it stands."""
import json
import os
import pathlib
import sys

import hostile

MOST_BYTES = 1 << 16      # of one file
MOST_FILES = 2000
MOST_PRINTED = 48 << 10   # a flood would be read slowly, and be a case of its own
SKIPPED = ("/usr", "/sys", "/var", "/proc", "/dev", "/policy/needles.bin")  # /var: the runtime
OF_A_PROCESS = ("cmdline", "environ", "maps", "mountinfo", "stat", "status", "limits", "cgroup")


def needles():
    flipped = pathlib.Path(__file__).with_name("needles.bin").read_bytes()
    words = json.loads(bytes(byte ^ 0xff for byte in flipped))
    wanted = {}
    for name, word in words.items():
        wanted[name] = [word.encode()]
        if word.isdigit():
            number = int(word)
            wanted[name] += [f"{number:x}".encode(), number.to_bytes(8, "little"),
                             number.to_bytes(8, "big")]
        else:
            wanted[name].append(bytes.fromhex(word))
    return wanted


def files():
    for folder, folders, names in os.walk("/"):
        folders[:] = [name for name in folders if os.path.join(folder, name) not in SKIPPED]
        for name in names:
            path = os.path.join(folder, name)
            if path not in SKIPPED:
                yield path
    for place in os.listdir("/proc"):
        if place.isdigit():
            yield from (f"/proc/{place}/{name}" for name in OF_A_PROCESS)
        elif os.path.isfile(f"/proc/{place}") and place not in ("kmsg", "kcore"):
            yield f"/proc/{place}"
    for name in os.listdir("/dev/shm"):
        yield f"/dev/shm/{name}"


def read(path):
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        return os.read(handle, MOST_BYTES)
    except OSError:
        return None
    finally:
        os.close(handle)


def look(player):
    wanted = needles()
    seen, count = set(), 0
    told = [("arguments", json.dumps(sys.argv).encode()),
            ("environment", json.dumps(dict(os.environ)).encode()),
            ("messages", str(vars(player)).encode())]
    for path in files():
        if count == MOST_FILES:
            break
        content = read(path)
        if content is None:
            continue
        count += 1
        told.append((path, content))
    printed = 0
    for place, content in told:
        line = f"{place}: {content[:2000]!r}\n"
        printed += len(line)
        if printed <= MOST_PRINTED:
            sys.stdout.write(line)
        for name, forms in wanted.items():
            if any(form in content for form in forms):
                seen.add(f"{name} in {place}")
    sys.stdout.flush()
    hostile.report("files", count)
    hostile.report("seen", "; ".join(sorted(seen)) or "nothing")


hostile.play(look)

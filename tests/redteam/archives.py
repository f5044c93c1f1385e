"""Archives that must be rejected at submission: name -> the file's bytes. Everything that would
escape is called redteam-escaped, so that it can be searched for."""

import gzip
import io
import json
import shutil
import subprocess
import tarfile
import zipfile

from support import images
from support.submission import entry, tar

ESCAPED = "redteam-escaped"
MANIFEST = b'{"name": "archive", "command": ["./run"]}'
BOMB_BYTES = 100 << 20  # more than the suite's daemon takes unpacked
MANY_ENTRIES = 3000     # likewise
GOOD = (("policy.json", MANIFEST, 0o644), ("run", b"#!/bin/sh\n", 0o755))


def _tar(*further, good=GOOD, form=tarfile.PAX_FORMAT):
    """An archive of a valid submission plus other entries."""
    return tar([entry(name, content, mode=mode) for name, content, mode in good] + [*further],
               form)


def _link(name, target, kind=tarfile.SYMTYPE):
    return entry(name, type=kind, linkname=target)


def _zip(*further):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content, mode in (*GOOD, *further):
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return packed.getvalue()


def _claims_10_gb():
    """A header that claims 10 GB, without any content."""
    huge = tarfile.TarInfo("huge")
    huge.size = 10 * 10**9
    return _tar()[:-10240] + huge.tobuf(tarfile.GNU_FORMAT) + b"\0" * 512


def _through_link():
    return _tar(_link("way", "/tmp"), entry(f"way/{ESCAPED}", b"x"))


def good():
    # A layer may have what the sandbox replaces, setuid bits and links to anywhere.
    odd = _image([images.member("proc/version", b"x"), images.member("myograde/x", b"x"),
                  images.member("dev/mem", type=tarfile.CHRTYPE, devmajor=1, devminor=1),
                  images.member("policy/run", b"x", mode=0o4755), images.link("up", "../" * 20),
                  *images.program_layer("/bin/sh", name="bin/sh")])
    return {"plain.tar": _tar(), "packed.tar.gz": gzip.compress(_tar()), "packed.zip": _zip(),
            "image.tar": odd}


def _tars():
    bomb = _tar(entry("zeros", b"\0" * BOMB_BYTES))
    many = _tar(*(entry(f"many/{i}") for i in range(MANY_ENTRIES)))
    device = {"devmajor": 1, "devminor": 1}
    files = {
        "bomb.tar.gz": gzip.compress(bomb, 6),
        "many.tar.gz": gzip.compress(many, 1),
        "claim.tar": _claims_10_gb(),
        "up.tar": _tar(entry(f"../{ESCAPED}", b"x")),
        "inner-up.tar": _tar(entry(f"a/b/../../../{ESCAPED}", b"x")),
        "absolute.tar": _tar(entry(f"/tmp/{ESCAPED}", b"x")),
        "setuid.tar": _tar(entry("tool", b"x", mode=0o4755)),
        "setgid.tar": _tar(entry("tool", b"x", mode=0o2755)),
        "hard-link.tar": _tar(_link("passwd", "/etc/passwd", tarfile.LNKTYPE)),
        "hard-link-inside.tar": _tar(_link("two", "run", tarfile.LNKTYPE)),
        "device.tar": _tar(entry("mem", mode=0o666, type=tarfile.CHRTYPE, **device)),
        "block.tar": _tar(entry("disk", mode=0o666, type=tarfile.BLKTYPE, **device)),
        "pipe.tar": _tar(entry("pipe", type=tarfile.FIFOTYPE)),
        "link-up.tar": _tar(_link("up", "../../../etc")),
        "through-link.tar": _through_link(),
        "twice.tar": _tar(entry("run", b"#!/bin/false\n", mode=0o755)),
        "twice-as-folder.tar": _tar(entry("run", mode=0o755, type=tarfile.DIRTYPE)),
        "newline.tar": _tar(entry("new\nline", b"x")),
        "escape-codes.tar": _tar(entry("\x1b[2Jname", b"x")),
        "no-utf8.tar": _tar(entry("A\udcff\udcfeA", b"x"), form=tarfile.GNU_FORMAT),
        "damaged.tar": _tar(entry("AAAA", b"x")).replace(b"AAAA\0", b"BAAA\0"),
        "long-name.tar": _tar(entry("n" * 300, b"x")),
        "deep.tar": _tar(entry("d/" * 100 + "x", b"x")),
        "manifest-is-link.tar": _tar(_link("policy.json", "/etc/passwd"), good=GOOD[1:]),
        "program-is-loop.tar": _tar(_link("run", "run"), good=GOOD[:1]),
        "no-manifest.tar": _tar(good=GOOD[1:]),
        "no-program.tar": _tar(good=GOOD[:1]),
        "cut.tar": _tar(entry("data", b"x" * 5000))[:5000],
        "garbage.tar": b"this is not an archive" * 100,
        "empty.tar": b"",
    }
    if shutil.which("zstd"):
        files["bomb.tar.zst"] = subprocess.run(["zstd", "-q", "-c"], input=bomb, check=True,
                                               stdout=subprocess.PIPE).stdout
    return files


def _zips():
    return {
        "bomb.zip": _zip(("zeros", b"\0" * BOMB_BYTES, 0o644)),
        "many.zip": _zip(*((f"many/{i}", b"", 0o644) for i in range(MANY_ENTRIES))),
        "up.zip": _zip((f"../{ESCAPED}", b"x", 0o644)),
        "absolute.zip": _zip((f"/tmp/{ESCAPED}", b"x", 0o644)),
        "link-up.zip": _zip(("up", b"../../etc", 0o120777)),
        "setuid.zip": _zip(("tool", b"x", 0o104755)),
    }


RUN = [images.member("run", b"#!/bin/sh\n", mode=0o755), images.folder("bin")]


def _image(*layers, **about):
    return images.image([RUN, *layers], **{"entrypoint": ("/run",), **about})


def _lying(change, form=images.docker):
    """An image's archive of which `change` spoils the files: name -> bytes."""
    layers = [images.tar(RUN), images.tar([images.member("data", b"x" * 5000)])]
    files = form(layers, images.config(layers, entrypoint=("/run",)))
    change(files)
    return images.archive(files)


def _replace_layer(files):
    name = next(name for name in files if name.endswith("layer.tar"))
    files[name] = images.tar([images.member("other", b"y")])


def _replace_blob(files):
    data = next(name for name in files if b"xxxx" in files[name])
    files[data] = files[data].replace(b"x", b"y")


def _lie_about_sizes(files):
    index = json.loads(files["index.json"])
    index["manifests"][0]["size"] = 7
    files["index.json"] = json.dumps(index).encode()


def _images():
    """Container images. What would escape is below links, in whiteouts and in other layers."""
    up = "../" * 20
    device = {"devmajor": 1, "devminor": 1}
    return {
        "image-device.tar": _image([images.member("mem", type=tarfile.CHRTYPE, **device)]),
        "image-pipe.tar": _image([images.member("pipe", type=tarfile.FIFOTYPE)]),
        "image-up.tar": _image([images.member(f"{up}tmp/{ESCAPED}", b"x")]),
        "image-hard-link.tar": _image([images.hard_link("passwd", "/etc/passwd")]),
        "image-hard-link-up.tar": _image([images.hard_link("passwd", up + "etc/passwd")]),
        # Refused for the whiteout, after the links were used.
        "image-through-link.tar": _image(
            [images.link("way", "/tmp"), images.link("up", up + "tmp")],
            [images.member(f"way/{ESCAPED}", b"x"), images.member(f"up/{ESCAPED}", b"x"),
             images.member("way/.wh...")]),
        "image-link-loop.tar": _image([images.link("loop", "loop"), images.member("loop/x", b"x")]),
        "image-no-whiteout.tar": _image([images.member(".wh.")]),
        "image-preload.tar": _image([images.member("etc/ld.so.preload", b"/evil.so")]),
        "image-etc-link.tar": _image([images.link("etc", "/tmp")]),
        "image-arm.tar": _image(architecture="arm64"),
        "image-windows.tar": _image(system="windows"),
        "image-foreign-program.tar": _image(
            [images.member("run", b"\x7fELF\x02\x01\x01" + bytes(9) + b"\2\0\xb7\0" + bytes(200),
                           mode=0o755)]),
        "image-no-program.tar": _image([images.member(".wh.run")]),
        "image-program-in-tmp.tar": _image([images.member("tmp/run", b"#!/bin/sh\n", mode=0o755)],
                                           entrypoint=("/tmp/run",)),
        "image-unknown-user.tar": _image(user="nobody-knows"),
        "image-folder-in-proc.tar": _image(workdir="/proc/self"),
        "image-many.tar": _image([images.member(f"many/{i}") for i in range(MANY_ENTRIES)]),
        "image-bomb.tar.gz": gzip.compress(_image([images.member("zeros", b"\0" * BOMB_BYTES)]), 1),
        "image-again.tar": _image(*[[images.member("same", bytes([i]) * (BOMB_BYTES // 9))]
                                    for i in range(10)], form="oci-gzip"),
        "image-layer-lie.tar": _lying(_replace_layer),
        "image-blob-lie.tar": _lying(_replace_blob, images.oci),
        "image-size-lie.tar": _lying(_lie_about_sizes, images.oci),
        "image-two.tar": _lying(lambda files: files.update(
            {"manifest.json": json.dumps(json.loads(files["manifest.json"]) * 2).encode()})),
        "image-config-elsewhere.tar": _lying(lambda files: files.update(
            {"manifest.json": files["manifest.json"].replace(b'"Config": "', b'"Config": "elsewhere/')})),
        "image-deep-json.tar": _lying(lambda files: files.update(
            {"manifest.json": b"[" * 100_000})),
    }


def bad():
    return {**_tars(), **_zips(), **_images()}

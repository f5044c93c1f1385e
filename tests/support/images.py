"""Makes container images by hand: archives in Docker's form and in OCI's layout, from dictionaries.

A layer is a list of tar members (`member`), an image a list of layers and a config. Every digest,
size and file may be lied about, by changing what `oci` and `docker` return before it is packed."""

import gzip
import hashlib
import io
import json
import os
import pathlib
import shutil
import subprocess
import tarfile

OCI_MANIFEST = "application/vnd.oci.image.manifest.v1+json"
OCI_INDEX = "application/vnd.oci.image.index.v1+json"
OCI_CONFIG = "application/vnd.oci.image.config.v1+json"
OCI_LAYER = "application/vnd.oci.image.layer.v1.tar"
TIME = 1_700_000_000


def sha256(content):
    return hashlib.sha256(content).hexdigest()


def member(name, content=b"", mode=0o644, type=tarfile.REGTYPE, linkname="", **fields):
    """One member of a layer, as a pair that tarfile takes."""
    info = tarfile.TarInfo(name)
    info.mode = mode
    info.type = type
    info.linkname = linkname
    info.mtime = TIME
    info.size = len(content) if type == tarfile.REGTYPE else 0
    for key, value in fields.items():
        setattr(info, key, value)
    return info, content


def folder(name, mode=0o755):
    return member(name, mode=mode, type=tarfile.DIRTYPE)


def link(name, target):
    return member(name, type=tarfile.SYMTYPE, linkname=target)


def hard_link(name, target):
    return member(name, type=tarfile.LNKTYPE, linkname=target)


def tar(members):
    """The bytes of a tar of members."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for info, content in members:
            archive.addfile(info, io.BytesIO(content))
    return packed.getvalue()


def zstd(content):
    return subprocess.run(["zstd", "-q", "-c"], input=content, stdout=subprocess.PIPE,
                          check=True).stdout


def config(layers, entrypoint=("/policy",), cmd=None, env=("PATH=/bin",), workdir="", user="",
           architecture="amd64", system="linux"):
    """An image's config for these uncompressed layers (bytes)."""
    return {"architecture": architecture, "os": system,
            "config": {"Entrypoint": None if entrypoint is None else list(entrypoint),
                       "Cmd": cmd, "Env": list(env), "WorkingDir": workdir, "User": user},
            "rootfs": {"type": "layers", "diff_ids": ["sha256:" + sha256(one) for one in layers]}}


def docker(layers, about, tag="agent:latest"):
    """The files of Docker's form: name -> bytes, in order."""
    text = json.dumps(about).encode()
    files = {f"{sha256(layer)}/layer.tar": layer for layer in layers}
    files[f"{sha256(text)}.json"] = text
    manifest = [{"Config": f"{sha256(text)}.json", "RepoTags": [tag] if tag else None,
                 "Layers": [f"{sha256(layer)}/layer.tar" for layer in layers]}]
    files["manifest.json"] = json.dumps(manifest).encode()
    return files


def oci(layers, about, tag="agent:latest", pack=lambda layer: layer, kind=OCI_LAYER,
        platform=("linux", "amd64")):
    """The files of OCI's layout: name -> bytes, in order. `pack` compresses a layer."""
    files = {}

    def blob(content, media_type, **more):
        files[f"blobs/sha256/{sha256(content)}"] = content
        return {"mediaType": media_type, "digest": "sha256:" + sha256(content),
                "size": len(content), **more}

    manifest = {"schemaVersion": 2, "mediaType": OCI_MANIFEST,
                "config": blob(json.dumps(about).encode(), OCI_CONFIG),
                "layers": [blob(pack(layer), kind) for layer in layers]}
    more = {"annotations": {"org.opencontainers.image.ref.name": tag}} if tag else {}
    if platform:
        more["platform"] = {"os": platform[0], "architecture": platform[1]}
    index = {"schemaVersion": 2,
             "manifests": [blob(json.dumps(manifest).encode(), OCI_MANIFEST, **more)]}
    files["index.json"] = json.dumps(index).encode()
    files["oci-layout"] = b'{"imageLayoutVersion": "1.0.0"}'
    return files


def archive(files):
    """The archive that holds these files."""
    return tar(member(name, content) for name, content in files.items())


def image(layers, form="docker", **about):
    """A whole image's archive from layers of members."""
    packed = [tar(layer) for layer in layers]
    described = config(packed, **about)
    if form == "docker":
        return archive(docker(packed, described))
    if form == "oci":
        return archive(oci(packed, described))
    if form == "oci-gzip":
        return archive(oci(packed, described, pack=gzip.compress, kind=OCI_LAYER + "+gzip"))
    if form == "oci-zstd":
        return archive(oci(packed, described, pack=zstd, kind=OCI_LAYER + "+zstd"))
    raise ValueError(form)


def program_layer(program, name="policy", more=()):
    """A layer with a dynamic program of this host, its libraries and its loader, at the places where
    Debian's images have them."""
    lines = subprocess.run(["ldd", program], stdout=subprocess.PIPE, text=True, check=True).stdout
    paths = {word for line in lines.splitlines() for word in line.split() if word.startswith("/")}
    members = [folder("usr"), link("lib", "usr/lib"), link("lib64", "usr/lib64"),
               member(name, pathlib.Path(program).read_bytes(), mode=0o755)]
    for path in sorted(paths | set(more)):
        place = "usr" + path if path.startswith("/lib") else path.lstrip("/")
        members.append(member(place, pathlib.Path(os.path.realpath(path)).read_bytes(), mode=0o755))
    return members


def has_engine():
    """Whether images can be built here by the usual tools."""
    return shutil.which("buildah") is not None and shutil.which("podman") is not None

"""Certificates, made by the openssl program."""

import pathlib
import subprocess

# `openssl ca` alone can date a certificate back.
AUTHORITY = """[ca]
default_ca = own
[own]
dir = {folder}
database = $dir/index
rand_serial = yes
new_certs_dir = $dir
default_md = sha256
policy = any
x509_extensions = hosts
[any]
commonName = supplied
[hosts]
subjectAltName = {hosts}
"""


def _openssl(*words):
    subprocess.run(["openssl", *words], check=True, capture_output=True,
                   stdin=subprocess.DEVNULL, timeout=60)


def make_certificate(folder, name="server", hosts=("IP:127.0.0.1", "DNS:localhost"), expired=False):
    """Writes NAME.pem, a certificate for `hosts` that is signed by itself, and NAME.key to `folder`;
    returns both paths. It is valid for a month, or was so for the first one of the year 2020."""
    certificate, key = (pathlib.Path(folder) / f"{name}.{end}" for end in ("pem", "key"))
    new = ["req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout", key,
           "-subj", f"/CN={name}"]
    if not expired:
        _openssl(*new, "-x509", "-out", certificate, "-days", "30",
                 "-addext", f"subjectAltName={','.join(hosts)}")
    else:
        authority = pathlib.Path(folder) / f"{name}-authority"
        authority.mkdir()
        (authority / "index").touch()
        config, request = authority / "config", authority / "request"
        config.write_text(AUTHORITY.format(folder=authority, hosts=",".join(hosts)))
        _openssl(*new, "-out", request)
        _openssl("ca", "-batch", "-selfsign", "-config", config, "-keyfile", key, "-in", request,
                 "-notext", "-out", certificate, "-startdate", "20200101000000Z", "-enddate",
                 "20200201000000Z")
    key.chmod(0o600)
    return certificate, key

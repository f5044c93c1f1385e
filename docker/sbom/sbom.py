#!/usr/bin/python3
"""Writes what a release is made of: a bill of materials in SPDX 2.3 (sbom.spdx.json), and the texts of
the licences of all that it names, with a list of them (NOTICE.txt). The same programs, sources, Debian
packages and date give the same bytes."""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

import components
import texts
from components import Component, Trouble

SOURCE = pathlib.Path(__file__).resolve().parents[2]
DOCUMENT = "SPDXRef-DOCUMENT"
PROJECT = "SPDXRef-Package-myograde"
EXAMPLES = """examples:
  docker/sbom/sbom.py --programs build/release/bin --cache /var/cache/myograde build/sbom
  SOURCE_DATE_EPOCH=1700000000 docker/sbom/sbom.py --programs /usr/local/bin --json build/sbom"""


def created(source: pathlib.Path) -> str:
    """The document's date: SOURCE_DATE_EPOCH, or that of the last commit."""
    seconds = os.environ.get("SOURCE_DATE_EPOCH")
    if seconds is None:
        done = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=source, capture_output=True,
                              text=True, timeout=60, check=False)
        seconds = done.stdout.strip()
        if done.returncode != 0 or not seconds:
            raise Trouble(f"git tells no date of a last commit in {source}; set SOURCE_DATE_EPOCH to "
                          "the seconds since 1970 of the release")
    try:
        moment = datetime.datetime.fromtimestamp(int(seconds), datetime.timezone.utc)
    except (ValueError, OverflowError, OSError):
        raise Trouble(f'SOURCE_DATE_EPOCH is "{seconds}"; it must be seconds since 1970') from None
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def project_version(source: pathlib.Path) -> str:
    file = source / "CMakeLists.txt"
    match = re.search(r"^project\(myograde VERSION ([\d.]+)", file.read_text(encoding="utf-8"), re.M)
    if match is None:
        raise Trouble(f"{file} states no version of the project")
    return match.group(1)


def project_package(version: str) -> dict:
    return {"SPDXID": PROJECT, "name": "myograde", "versionInfo": version,
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False,
            "licenseConcluded": "Apache-2.0", "licenseDeclared": "Apache-2.0",
            "copyrightText": "The MyoGrade authors", "supplier": "Organization: MyoGrade",
            "primaryPackagePurpose": "APPLICATION"}


def package(component: Component) -> dict:
    """The component as SPDX has it."""
    entry = {"SPDXID": component.identifier, "name": component.name,
             "downloadLocation": "NOASSERTION", "filesAnalyzed": False,
             "licenseConcluded": "NOASSERTION",
             "licenseDeclared": component.licence or component.own_licence,
             "copyrightText": "NOASSERTION"}
    if component.version:
        entry["versionInfo"] = component.version
    if component.comment:
        entry["comment"] = component.comment
    if component.origin:
        entry["sourceInfo"] = f"built from the source package {component.origin}"
    if component.sha256:
        entry["checksums"] = [{"algorithm": "SHA256", "checksumValue": component.sha256}]
    if component.purl:
        entry["externalRefs"] = [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                                  "referenceLocator": component.purl}]
    return entry


def relation(component: Component) -> dict:
    first, second = PROJECT, component.identifier
    if component.within:
        first = component.within
    elif component.role.endswith("_OF"):
        first, second = second, first
    return {"spdxElementId": first, "relationshipType": component.role,
            "relatedSpdxElement": second}


def document(version: str, date: str, found: list[Component]) -> dict:
    body = {
        "packages": [project_package(version), *map(package, found)],
        "hasExtractedLicensingInfos": [
            {"licenseId": component.own_licence, "name": f"licences of {component.name}",
             "extractedText": component.licence_text}
            for component in found if not component.licence],
        "relationships": [{"spdxElementId": DOCUMENT, "relationshipType": "DESCRIBES",
                           "relatedSpdxElement": PROJECT}, *map(relation, found)],
    }
    digest = hashlib.sha256(json.dumps([date, body], sort_keys=True).encode()).hexdigest()
    return {
        "spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": DOCUMENT,
        "name": f"myograde-{version}",
        # Stands for the content; nothing is served there.
        "documentNamespace": f"https://spdx.org/spdxdocs/myograde-{version}-{digest[:32]}",
        "creationInfo": {"created": date, "creators": ["Tool: myograde-sbom"]},
        **body,
    }


def write(target: pathlib.Path, bill: dict, found: list[Component], source: pathlib.Path,
          cache: pathlib.Path | None) -> list[str]:
    """Fills `target` anew. Returns the names of the components without a licence text here."""
    target.mkdir(parents=True, exist_ok=True)
    (target / "sbom.spdx.json").write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8")
    return texts.write(found, target, cache, source, "What has none is in no release: an organiser's server fetches "
                       "it with its runtime.\n")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, epilog=EXAMPLES,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True,
                        help="folder with the programs, of the build or installed")
    parser.add_argument("--source", type=pathlib.Path, default=SOURCE, help="the sources (default: these)")
    parser.add_argument("--cache", type=pathlib.Path, default=os.environ.get("MYOGRADE_CACHE"),
                        help="folder that ./dev setup filled, with the wheels' licences (default: MYOGRADE_CACHE)")
    parser.add_argument("--json", action="store_true", help="print what was written as JSON")
    parser.add_argument("target", type=pathlib.Path, help="folder to write into")
    return parser.parse_args()


def main() -> int:
    words = arguments()
    try:
        date, version = created(words.source), project_version(words.source)
        found = components.find(words.source, words.programs)
        lacking = write(words.target, document(version, date, found), found, words.source, words.cache)
    except (Trouble, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 4
    if words.json:
        print(json.dumps({"folder": str(words.target), "packages": len(found), "without_text": lacking}))
    else:
        print(f"{words.target}/sbom.spdx.json names {len(found)} packages"
              + (f"; no licence text here of {', '.join(lacking)}" if lacking else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())

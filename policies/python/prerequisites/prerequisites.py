"""What a machine needs to build the environments of the package, checked before the build.

pip does not tell a build which extras it is for. So a package that is built without the environments
requires this folder's project in its extra "gym", and building that fails with the reason. As a program:
prints the reason, or nothing, for the cache folder that its argument names."""

import importlib.util
import os
import pathlib
import platform
import shlex
import shutil
import sys
import sysconfig
from typing import Any, NoReturn, Optional

HERE = pathlib.Path(__file__).resolve().parent
EXTRAS = {"lcm": ["lcm>=1.5.1"], "gym": ["gymnasium>=0.29.1", "numpy>=1.21"]}
# Of the cache folder: the physics library and what makes modules for Python.
PACKAGES = ("mujoco-2.2.2", "nanobind-2.9.2")


def default_cache() -> pathlib.Path:
    """As the package that is built has it."""
    described = importlib.util.spec_from_file_location("models", HERE.parent / "myograde/models.py")
    assert described is not None and described.loader is not None
    models = importlib.util.module_from_spec(described)
    sys.modules[described.name] = models  # which its dataclasses look for
    described.loader.exec_module(models)
    return models.default_cache()


def missing(cache: Optional[pathlib.Path] = None) -> str:
    """What this machine lacks, as the end of a sentence; "" if nothing."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return f"they are for Linux on x86-64, and this is {platform.system()} on {platform.machine()}"
    named = shlex.split(os.environ.get("CXX", ""))[:1]
    if not any(map(shutil.which, [*named, "c++", "g++", "clang++"])):
        return "there is no C++ compiler (c++, g++ or clang++) on the PATH"
    header = pathlib.Path(sysconfig.get_path("include"), "Python.h")
    if not header.is_file():
        return f"the headers of this Python are not installed ({header})"
    cache = cache or default_cache()
    for package in PACKAGES:
        if not (cache / package).is_dir():
            return f"{cache} has no {package}"
    return ""


def explained(reason: str) -> str:
    return (f"The environments (myograde.envs) can't be built here: {reason}. Run ./dev setup in the "
            "checkout and install the package again, or install a wheel that ./dev wheel built.")


def dynamic_metadata(field: str, settings: Any = None) -> dict[str, list[str]]:
    """The package's extras; scikit-build-core asks for them."""
    if os.environ.get("MYOGRADE_PURE"):
        # A wheel for every platform, which never has the environments.
        return {"lcm": EXTRAS["lcm"]}
    if not missing():
        return EXTRAS
    return {**EXTRAS, "gym": [f"myograde-environments @ {HERE.as_uri()}"]}


def _refuse(*arguments: Any, **settings: Any) -> NoReturn:
    """Each step of building the project that can't be installed."""
    reason = missing()
    sys.exit(explained(reason) if reason else
             "The environments can be built here now; install the package again.")


get_requires_for_build_wheel = prepare_metadata_for_build_wheel = build_wheel = _refuse


if __name__ == "__main__":
    found = missing(pathlib.Path(sys.argv[1]) if sys.argv[1:] else None)
    print(explained(found) if found else "", end="")

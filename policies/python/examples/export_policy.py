#!/usr/bin/env python3
"""Makes a submission of a policy that train_ppo.py trained: a folder that needs NumPy alone.

    python export_policy.py elbow_ppo.zip elbow-ppo

The folder holds the weights of the network (weights.npz), the code that applies them (network.py,
policy.py), the kit, and policy.json. Needs stable-baselines3 and torch; the submission does not."""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import torch
from stable_baselines3 import PPO

HERE = pathlib.Path(__file__).resolve().parent


def layers_of(model: PPO) -> list[torch.nn.Linear]:
    """The actor's layers from observation to action. SystemExit if network.py would not do."""
    modules = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    layers = [module for module in modules if isinstance(module, torch.nn.Linear)]
    others = [module for module in modules if not isinstance(module, torch.nn.Linear)]
    if not all(isinstance(module, torch.nn.ReLU) for module in others):
        sys.exit("error: the policy's network has layers other than Linear and ReLU; train it by "
                 "train_ppo.py, or write its layers into network.py")
    return layers


def arrays_of(model: PPO) -> dict[str, np.ndarray]:
    """What weights.npz holds: float64, the layers' weights as rows of their outputs."""
    arrays = {"low": model.action_space.low.astype(np.float64),
              "high": model.action_space.high.astype(np.float64)}
    for number, layer in enumerate(layers_of(model)):
        arrays[f"weight{number}"] = layer.weight.detach().numpy().astype(np.float64)
        arrays[f"bias{number}"] = layer.bias.detach().numpy().astype(np.float64)
    return arrays


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=pathlib.Path, help="file of train_ppo.py")
    parser.add_argument("folder", type=pathlib.Path, help="a new folder for the submission")
    options = parser.parse_args()
    if not options.model.is_file():
        parser.error(f"there is no file {options.model}; train_ppo.py writes one")
    if options.folder.exists():
        parser.error(f"{options.folder} exists; name a folder that does not")
    arrays = arrays_of(PPO.load(options.model, device="cpu"))
    options.folder.mkdir(parents=True)
    np.savez(options.folder / "weights.npz", **arrays)
    for name in ("network.py", "policy.py"):
        shutil.copy(HERE / "submission" / name, options.folder)
    about = {"name": options.folder.resolve().name, "command": ["/usr/bin/python3", "policy.py"],
             "runtimes": ["python"]}
    (options.folder / "policy.json").write_text(json.dumps(about, indent=2) + "\n")
    subprocess.run([sys.executable, "-m", "myograde", "bundle", options.folder], check=True,
                   timeout=60)
    print(f"next: myograde local {options.folder} --track elbow")


if __name__ == "__main__":
    main()

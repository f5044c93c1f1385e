"""What the recorders of the hand's tracks share: whole episodes."""

import numpy as np

from official import extras, file_record, model_fields, muscle_actions, reset_record, state, step_record

MUSCLES = 39

ACTIONS = muscle_actions(MUSCLES)


def episode(wrapped, versions, name, seed, steps, act, model_record, made="env.unwrapped.seed(seed)"):
    """A golden file of one episode of the actions `act(step, generator)`. `model_record(env)`: what
    the reset's draws changed in the model."""
    env = wrapped.unwrapped
    reset = {
        **reset_record(wrapped),
        "model": {**model_fields(env, "body_iquat"), **model_record(env)},
        "obs_extra": extras(env.obs_dict, squeeze=False),
        "state_after_reset": state(env, "ncon"),
    }
    generator = np.random.Generator(np.random.PCG64([seed, 2022]))
    for step in range(steps):
        played = step_record(wrapped, act(step, generator))
        played["obs_extra"] = extras(env.obs_dict, squeeze=True)
        reset["steps"].append(played | state(env, "ncon"))
        if played["terminated"] or played["truncated"]:
            break
    path = {"env_infos": {"rwd_dict": {
        key: np.array([step["rwd_dict"][key] for step in reset["steps"]])
        for key in ("solved", "act_reg")}}}
    return file_record(
        env, versions, name, seed, act is ACTIONS["sine"],
        f"{made}, reset, {steps} steps through the time limit's wrapper",
        [reset], metrics=env.get_metrics([path]))

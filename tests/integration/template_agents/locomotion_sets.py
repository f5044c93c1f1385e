"""The leg's parameter sets in the form of the template."""


def state(knee, ankle, **thresholds):
    return {"gain": {"knee_stiffness": 99.372, "knee_damping": 3.18, "knee_target_angle": knee,
                     "ankle_stiffness": 19.874, "ankle_damping": 0.0, "ankle_target_angle": ankle},
            "threshold": thresholds}


def parameter_sets(knee):
    states = {"e_stance": state(knee, 0.0, ankle_angle=(0.1, "above")),
              "l_stance": state(knee, 0.1, load=(115.0, "below")),
              "e_swing": state(1.0, 0.2, knee_angle=(0.9, "above"), knee_vel=(0.05, "below")),
              "l_swing": state(0.1, 0.2, load=(300.0, "above"), knee_angle=(0.5, "below"))}
    return {index: states for index in range(4)}

// What the cluster knows of a job's energy.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <absl/time/time.h>

namespace myograde::server {

// Asks Slurm's sstat for the energy that the running job's step has used so far, in joules. nullopt:
// this is no job (SLURM_JOB_ID), or the cluster does not measure it or does not answer within `most`.
std::optional<double> EnergyOfJob(absl::Duration most = absl::Seconds(5));

// Of sstat's answer. 0 stands for what is not measured.
std::optional<double> ParseEnergy(std::string_view answer);

}  // namespace myograde::server

// Host checks that need no sandbox: programs, models, machine, system.
#pragma once

#include <vector>

#include <absl/time/time.h>

#include "server/sandbox/doctor.h"

namespace myograde::server {

// Each appends one or more checks.
void CheckPrograms(const DoctorOptions& options, std::vector<Check>& checks);
// Whether pictures and films of episodes can be made here.
void CheckPictures(std::vector<Check>& checks);
void CheckMujocoAndModels(const DoctorOptions& options, std::vector<Check>& checks);
void CheckMachine(const DoctorOptions& options, std::vector<Check>& checks);
void CheckSystem(const DoctorOptions& options, std::vector<Check>& checks);

// Time limit of a program with next to nothing to do.
inline constexpr absl::Duration kQuick = absl::Seconds(10);
inline constexpr size_t kMostPrinted = 1 << 20;  // bytes, by a program

// A check with the state kOk, kDegraded or kMissing.
Check Fine(std::string name, std::string found);
Check Poorer(std::string name, std::string found, std::string costs, std::string todo);
Check Missing(std::string name, std::string found, std::string costs, std::string todo);

}  // namespace myograde::server

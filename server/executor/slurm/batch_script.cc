#include "server/executor/slurm/batch_script.h"

#include <absl/strings/str_cat.h>
#include <absl/strings/str_replace.h>

namespace myograde::server {
namespace {

// As of sysexits.h: the task has no lease.
constexpr int kUsageStatus = 64;

std::string Option(const char* name, const std::string& value) {
  return value.empty() ? "" : absl::StrCat(" --", name, " ", ShellQuoted(value));
}

}  // namespace

std::string ShellQuoted(const std::string& word) {
  return absl::StrCat("'", absl::StrReplaceAll(word, {{"'", "'\\''"}}), "'");
}

std::string BatchScript(const ScriptPlaces& places, const std::vector<ScriptLease>& leases) {
  std::string script = "#!/bin/sh\ncase \"$SLURM_ARRAY_TASK_ID\" in\n";
  for (size_t task = 0; task < leases.size(); ++task) {
    absl::StrAppend(&script, task, ") lease=", ShellQuoted(leases[task].name));
    if (!leases[task].token.empty()) {
      absl::StrAppend(&script, "; export MYOGRADE_LEASE_TOKEN=", ShellQuoted(leases[task].token));
    }
    absl::StrAppend(&script, " ;;\n");
  }
  absl::StrAppend(&script, "*) exit ", kUsageStatus, " ;;\nesac\numask 077\n");
  // In the shell's place, so that Slurm's signals reach it.
  absl::StrAppend(&script, "exec ", ShellQuoted(places.program),
                  places.spool.empty() ? Option("url", places.url) : Option("spool", places.spool),
                  places.spool.empty() ? Option("ca", places.ca_file) : "", " --lease \"$lease\"",
                  Option("cache", places.cache_dir), Option("node-dir", places.node_dir),
                  Option("configs", places.configs_dir), "\n");
  return script;
}

}  // namespace myograde::server

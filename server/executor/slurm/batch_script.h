// The script of a job array whose tasks each play one lease.
#pragma once

#include <string>
#include <vector>

namespace myograde::server {

struct ScriptLease {
  std::string name;   // of its folder
  std::string token;  // for HTTPS; "": none
};

// Paths as they are on the nodes.
struct ScriptPlaces {
  std::string program;    // myograde-node
  std::string spool;      // "": HTTPS
  std::string url;
  std::string ca_file;    // "": the node's authorities
  std::string cache_dir;
  std::string node_dir;   // "": the program's choice
  std::string configs_dir;
};

// Task N plays leases[N]; any other task ends at once. Whoever reads the script can play these
// leases; Slurm shows it to the job's user and its operators alone.
std::string BatchScript(const ScriptPlaces& places, const std::vector<ScriptLease>& leases);

// The word as the shell reads it back.
std::string ShellQuoted(const std::string& word);

}  // namespace myograde::server

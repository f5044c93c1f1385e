// Options that several verbs have.
#pragma once

#include <cstdint>
#include <string>

#include <CLI/CLI.hpp>

namespace myograde::server {

// A check of options that are whole numbers from `least` on; `what` says in the error what the
// text is not: "no episode".
CLI::Validator WholeNumber(int64_t least, const std::string& what);

// Adds --json; the output is described by configs/schema/SCHEMA.json.
void AddJson(CLI::App& verb, const std::string& schema, bool& json,
             const std::string& help = "Print JSON");

// Adds --full-hashes.
void AddFullHashes(CLI::App& verb, bool& full);

// Where this host's configs and models are.
struct HostOptions {
  std::string configs;
  std::string cache;

  std::string configs_dir() const;
  std::string cache_dir() const;
};

// Adds --configs and --cache.
void AddHostOptions(CLI::App& verb, HostOptions& options);

}  // namespace myograde::server

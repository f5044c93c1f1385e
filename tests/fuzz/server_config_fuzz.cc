// The host's configs: server.json and the two of the sandboxes. The input is a patch to a shipped
// file; an accepted config has no limit of zero.
#include <array>

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "server/config/server_config.h"
#include "server/sandbox/sandbox_config.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

constexpr const char* kFiles[] = {"server.json", "sandbox/policy.json", "sandbox/sim.json"};

nlohmann::json Shipped(const std::string& name) {
  const auto json = ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/" + name);
  Require(json.ok(), "a shipped config is JSON");
  return *json;
}

// A folder with the shipped files.
const fuzz::Folder& Configs() {
  static const fuzz::Folder folder;
  static const bool made = [] {
    const bool ok = std::filesystem::create_directory(folder / "sandbox");
    for (const char* name : kFiles) fuzz::WriteFile(folder / name, CanonicalJson(Shipped(name)));
    return ok;
  }();
  Require(made, "a folder can be made");
  return folder;
}

void CheckServer() {
  const auto config = LoadServerConfig(Configs() / "server.json", "/cache");
  if (!config.ok()) return;
  Require(config->scheduler.slots >= 1 && config->scheduler.max_retries >= 1, "there are slots");
  for (const absl::Duration time :
       {config->scheduler.heartbeat, config->scheduler.retry_delay, config->lease_grace,
        config->http.request, config->http.upload, config->http.idle}) {
    Require(time > absl::ZeroDuration() && time < absl::Hours(1000), "every wait has an end");
  }
  Require(config->artefacts.bytes > 0 && config->artefacts.files > 0 &&
              config->artefacts.archive_bytes > 0 && config->artefacts.uploads > 0,
          "uploads are limited");
  Require(config->http.workers > 0 && config->http.clients > 0 && config->http.body_bytes > 0,
          "requests are limited");
  Require(config->http.socket_mode <= 0777, "the socket's mode is one");
  for (const auto& [name, path] : config->runtimes) {
    Require(path.starts_with('/'), "runtimes have absolute paths");
  }
}

void CheckSandboxes() {
  const auto config = LoadSandboxConfig(Configs().path().string());
  if (!config.ok()) return;
  Require(config->policy.kill_s > 0 && config->policy.cpu_refresh_s > 0, "a sandbox has an end");
  Require(config->sim.memory_bytes > 0 && config->sim.open_files > 0 && config->sim.silence_s > 0 &&
              config->sim.lease_slack_s > 0,
          "the simulator is limited");
}

}  // namespace

// The first byte chooses the file, and whether the input is a patch or a whole file.
MYOGRADE_FUZZ_TARGET(server_config)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const uint8_t choice = input.Byte();
  const std::string text = input.RestText();
  static const std::array shipped = {Shipped(kFiles[0]), Shipped(kFiles[1]), Shipped(kFiles[2])};
  const size_t which = (choice >> 1) % shipped.size();
  const std::string file = Configs() / kFiles[which];
  const absl::StatusOr<nlohmann::json> patch = ParseJson(text, "patch");
  if ((choice & 1) == 0 && patch.ok()) {
    nlohmann::json merged = shipped[which];
    merged.merge_patch(*patch);
    fuzz::WriteFile(file, CanonicalJson(merged));
  } else {
    fuzz::WriteFile(file, text);
  }
  if (which == 0) {
    CheckServer();
  } else {
    CheckSandboxes();
  }
  fuzz::WriteFile(file, CanonicalJson(shipped[which]));
  return 0;
}

// Container images by hand: layers as tars, with a config and a manifest that state their digests.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "protocol/base/sha256.h"
#include "tests/server/artefact/raw_tar.h"

namespace myograde::server {

inline std::string EndOfTar() { return std::string(1024, '\0'); }

// A layer of entries made by TarEntry.
inline std::string Layer(const std::string& entries) { return entries + EndOfTar(); }

inline nlohmann::json ImageConfigOf(const std::vector<std::string>& layers,
                                    nlohmann::json config = {{"Entrypoint", {"/run"}}}) {
  nlohmann::json ids = nlohmann::json::array();
  for (const std::string& layer : layers) ids.push_back("sha256:" + Sha256Hex(layer));
  return {{"architecture", "amd64"},
          {"os", "linux"},
          {"config", std::move(config)},
          {"rootfs", {{"type", "layers"}, {"diff_ids", ids}}}};
}

// In Docker's form. `stored`: what is in the archive instead of the layers that the config states.
inline std::string DockerImage(const std::vector<std::string>& layers, const nlohmann::json& config,
                               const std::vector<std::string>& stored) {
  const std::string text = config.dump();
  nlohmann::json names = nlohmann::json::array();
  std::string tar;
  for (size_t i = 0; i < layers.size(); ++i) {
    names.push_back(Sha256Hex(layers[i]) + "/layer.tar");
    tar += TarEntry('0', names.back().get<std::string>(), stored[i]);
  }
  const std::string config_name = Sha256Hex(text) + ".json";
  nlohmann::json manifest = nlohmann::json::array();
  manifest.push_back(nlohmann::json::object(
      {{"Config", config_name}, {"RepoTags", {"host/agent:latest"}}, {"Layers", names}}));
  return tar + TarEntry('0', config_name, text) + TarEntry('0', "manifest.json", manifest.dump()) +
         EndOfTar();
}

inline std::string DockerImage(const std::vector<std::string>& layers,
                               const nlohmann::json& config) {
  return DockerImage(layers, config, layers);
}

inline std::string DockerImage(const std::vector<std::string>& layers) {
  return DockerImage(layers, ImageConfigOf(layers));
}

}  // namespace myograde::server

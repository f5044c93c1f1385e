// What must hold after unpacking any archive.
#pragma once

#include <string>

#include "server/artefact/artefact.h"
#include "tests/fuzz/fuzz.h"

namespace myograde::fuzz {

inline constexpr server::ArtefactLimits kSmallLimits = {
    .bytes = 1 << 20, .files = 40, .depth = 6, .name_bytes = 64};

// Unpacks `bytes` in `folder`: the result is either one sentence and nothing left, or a folder
// within the limits that packs and unpacks to the same digest.
inline void CheckUnpack(const Folder& folder, std::string_view bytes) {
  const std::string archive = folder / "archive";
  const std::string out = folder / "out";
  WriteFile(archive, bytes);
  const auto artefact = server::UnpackArtefact(archive, out, kSmallLimits);
  if (!artefact.ok()) {
    Require(absl::IsInvalidArgument(artefact.status()), "a bad archive is the participant's");
    Require(!artefact.status().message().empty() &&
                artefact.status().message().find('\n') == absl::string_view::npos,
            "a refusal is one line");
    Require(!std::filesystem::exists(std::filesystem::symlink_status(out)), "nothing is left");
    return;
  }
  Require(artefact->bytes <= kSmallLimits.bytes && artefact->files <= kSmallLimits.files,
          "the limits hold");
  // An image's tree keeps links that ordinary submissions may not have.
  if (artefact->manifest.image.has_value()) {
    std::filesystem::remove_all(out);
    return;
  }
  // Nothing was created beside the folder.
  int entries = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    entries += entry.path().filename() != "packed" ? 1 : 0;
  }
  Require(entries == 2, "nothing is written outside");
  const auto packed = server::PackArtefact(out, folder / "packed", kSmallLimits);
  Require(packed.ok(), "what was unpacked can be packed");
  const auto again = server::UnpackArtefact(folder / "packed", folder / "again", kSmallLimits);
  Require(again.ok() && again->digest == artefact->digest && again->bytes == artefact->bytes &&
              again->files == artefact->files,
          "an artefact keeps its identity");
  std::filesystem::remove_all(folder / "again");
  std::filesystem::remove_all(out);
}

}  // namespace myograde::fuzz

// What a policy is called, and which tracks its adapter plays: what is said of it beside its files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/tracks/registry.h"
#include "protocol/tracks/track_kind.h"
#include "server/artefact/adapters.h"
#include "server/artefact/artefact.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/artefact/image_builder.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

void MakeFile(const std::string& path, const std::string& content, mode_t mode) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path) << content;
  ASSERT_EQ(::chmod(path.c_str(), mode), 0);
}

TEST(PackArtefact, AGivenNameComesOverTheSubmissions) {
  const TestFolder temp;
  MakeFile(temp / "named/policy.json", R"({"name": "old", "command": ["./policy"], "runtimes":
      ["torch-cpu"], "adapter": "template-2024"})", 0644);
  MakeFile(temp / "nameless/policy.json", R"({"command": ["./policy"]})", 0644);
  for (const char* folder : {"named", "nameless"}) {
    MakeFile(temp / (std::string(folder) + "/policy"), "#!/bin/sh\n", 0755);
  }
  const auto name_of = [&](const std::string& path, const std::string& name) {
    fs::remove_all(temp / "out");
    const auto packed = PackArtefact(path, temp / "packed", {}, nullptr, name);
    if (!packed.ok()) return std::string(packed.status().message());
    const auto artefact = UnpackArtefact(temp / "packed", temp / "out", {});
    if (!artefact.ok()) return std::string(artefact.status().message());
    EXPECT_EQ(artefact->manifest.name, packed->name);
    EXPECT_EQ(artefact->manifest.command, packed->command);
    EXPECT_EQ(artefact->manifest.runtimes, packed->runtimes);
    EXPECT_EQ(artefact->manifest.adapter, packed->adapter);
    return packed->name;
  };
  EXPECT_EQ(name_of(temp / "named", ""), "old");
  ASSERT_TRUE(PackArtefact(temp / "named", temp / "named.tar", {}).ok());
  WritePacked(temp / "nameless.tar.gz",
              TarEntry('0', "policy.json", R"({"command": ["./policy"]})") +
                  TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'),
              Kind::kTarGz);
  for (const char* path : {"named", "nameless", "named.tar", "nameless.tar.gz", "named/policy"}) {
    EXPECT_EQ(name_of(temp / path, "n\xc3\xa9w \"$x$\""), "n\xc3\xa9w \"$x$\"") << path;
  }
  for (const char* path : {"nameless", "nameless.tar.gz"}) {
    EXPECT_THAT(name_of(temp / path, ""), HasSubstr("name")) << path;
    EXPECT_FALSE(fs::exists(temp / "packed.unpacked"));
  }
  for (const std::string& bad : {std::string(65, 'x'), std::string(" "), std::string("a\nb")}) {
    EXPECT_THAT(name_of(temp / "named", bad), HasSubstr("the name ")) << bad;
  }
  MakeFile(temp / "older/policy.json", R"({"name": "old", "command": ["./policy"], "adapter":
      "template-2022"})",
           0644);
  MakeFile(temp / "older/policy", "#!/bin/sh\n", 0755);
  EXPECT_EQ(PackArtefact(temp / "older", temp / "packed", {})->runtimes,
            std::vector<std::string>{"template-2024"});
  // What the adapter runs in is among the runtimes that are asked for before anything is sent.
  EXPECT_EQ(PackArtefact(temp / "named", temp / "packed", {})->runtimes,
            (std::vector<std::string>{"torch-cpu", "template-2024"}));
}

TEST(Adapters, PlayOnlyTracksOfTheirTemplate) {
  const std::map<std::string_view, std::string> theirs = {
      {"reorientation", "template-2022"}, {"baoding", "template-2022"},
      {"relocation", "template-2023"},    {"chasetag", "template-2023"},
      {"manipulation", "template-2024"},  {"locomotion", "template-2024"}};
  for (const TrackKind* track : AllTracks()) {
    const auto own = theirs.find(track->name);
    for (const std::string& adapter : AdapterNames()) {
      EXPECT_EQ(CheckAdapter(adapter, *track).ok(), own != theirs.end() && own->second == adapter)
          << adapter << " on " << track->name;
    }
    EXPECT_TRUE(CheckAdapter("", *track).ok());
  }
  EXPECT_THAT(
      std::string(CheckAdapter("template-2022", *FindTrack("locomotion")).message()),
      HasSubstr("is \"template-2022\", which does not support tracks of the kind \"locomotion\""));
  EXPECT_THAT(std::string(CheckAdapter("template-2024", *FindTrack("elbow")).message()),
              HasSubstr("does not support tracks of the kind \"elbow\""));
}

TEST(PackArtefact, AnImagesNameIsTheGivenOneThenThatOfItsTagThenItsFiles) {
  const TestFolder temp;
  const std::string run = TarEntry('0', "run", "#!/bin/sh\n", {}, 0755);
  const std::string image = DockerImage({Layer(run)});
  const auto write = [&](const std::string& file, Kind kind, const std::string& bytes) {
    WritePacked(temp / file, bytes, kind);
    return temp / file;
  };
  const auto name_of = [&](const std::string& path, const std::string& name) {
    const auto packed = PackArtefact(path, temp / "packed", {}, nullptr, name);
    if (!packed.ok()) return std::string(packed.status().message());
    EXPECT_TRUE(packed->command.empty());
    fs::remove_all(temp / "out");
    const auto artefact = UnpackArtefact(temp / "packed", temp / "out", {});
    return artefact.ok() ? artefact->manifest.name : std::string(artefact.status().message());
  };
  for (const auto& [file, kind] : {std::pair("saved.tar", Kind::kTar), {"saved.tgz", Kind::kTarGz},
                                   {"saved.tar.zst", Kind::kTarZst}, {"SAVED.TAR", Kind::kTar},
                                   {"saved", Kind::kTar}, {"saved.oci", Kind::kTarGz}}) {
    const std::string path = write(file, kind, image);
    EXPECT_EQ(name_of(path, ""), "agent") << file;
    EXPECT_EQ(name_of(path, "mine"), "mine") << file;
  }
  // Without a tag.
  std::string nameless = image;
  const size_t tag = nameless.find("host/agent:latest");
  nameless.replace(tag - 1, 19, std::string(19, ' '));  // "RepoTags": [ ]
  EXPECT_EQ(name_of(write("agent-7.tar.gz", Kind::kTarGz, nameless), ""), "agent-7");
  EXPECT_EQ(name_of(write("AGENT.TAR", Kind::kTar, nameless), ""), "AGENT");
  // A folder with an image needs no name of its own then.
  fs::create_directory(temp / "p");
  std::ofstream(temp / "p/my.tar") << image;
  std::ofstream(temp / "p/policy.json") << R"({"image": "my.tar"})";
  EXPECT_EQ(name_of(temp / "p", "mine"), "mine");
  EXPECT_THAT(name_of(temp / "p", ""), HasSubstr("name"));
}

}  // namespace
}  // namespace myograde::server

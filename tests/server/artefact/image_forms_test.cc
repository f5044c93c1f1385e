// The forms in which tools write the archive of an image.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "protocol/base/sha256.h"
#include "server/artefact/artefact.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/artefact/image_builder.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using Json = nlohmann::json;

const std::string kRunEntry = TarEntry('0', "run", "#!/bin/sh\n", {}, 0755);

class ImageFormsTest : public ::testing::Test {
 protected:
  absl::StatusOr<Artefact> Unpack(const std::string& archive) {
    std::ofstream(temp_ / "a") << archive;
    fs::remove_all(temp_ / "out");
    return UnpackArtefact(temp_ / "a", temp_ / "out", {});
  }
  bool Has(const std::string& path) { return fs::exists(temp_ / ("out/image/" + path)); }

  const TestFolder temp_;
};

TEST_F(ImageFormsTest, TheOrderAndNamesOfMembersDoNotMatter) {
  const std::string layer = Layer(kRunEntry);
  const std::string config = ImageConfigOf({layer}).dump();
  const auto digest = Unpack(DockerImage({layer}));
  ASSERT_TRUE(digest.ok()) << digest.status();
  struct Names {
    std::string before, config, layer;
  };
  for (const Names& names : {Names{"", "sha256:" + Sha256Hex(config), Sha256Hex(layer) + ".tar.gz"},
                             Names{"", "config.json", "layer.tar"}, Names{"./", "config.json", "a/b/layer.tar"},
                             Names{"./", Sha256Hex(config) + ".json", Sha256Hex(layer) + "/layer.tar"}}) {
    const Json manifest = Json::array({Json::object({{"Config", names.config},
                                                     {"RepoTags", {"host/agent:latest"}},
                                                     {"Layers", {names.layer}}})});
    std::vector<std::string> members = {TarEntry('0', names.before + names.config, config),
                                        TarEntry('0', names.before + names.layer, layer),
                                        TarEntry('0', names.before + "manifest.json", manifest.dump())};
    std::sort(members.begin(), members.end());
    do {
      const std::string top = names.before.empty() ? "" : TarEntry('5', "./");
      const auto image = Unpack(top + members[0] + members[1] + members[2] + EndOfTar());
      ASSERT_TRUE(image.ok()) << names.config << ": " << image.status();
      EXPECT_EQ(image->digest, digest->digest);
    } while (std::next_permutation(members.begin(), members.end()));
    // Compressed as a whole, by whatever docker load takes; an equal member twice.
    const std::string whole = members[0] + members[1] + members[0] + members[2] + EndOfTar();
    for (const Kind kind : {Kind::kTar, Kind::kTarGz, Kind::kTarZst, Kind::kTarXz, Kind::kTarBz2}) {
      WritePacked(temp_ / "a", whole, kind);
      fs::remove_all(temp_ / "out");
      const auto packed = UnpackArtefact(temp_ / "a", temp_ / "out", {});
      ASSERT_TRUE(packed.ok()) << packed.status();
      EXPECT_EQ(packed->digest, digest->digest);
    }
  }
  const std::string other = TarEntry('0', Sha256Hex(layer) + "/layer.tar", Layer(TarEntry('0', "x")));
  EXPECT_THAT(std::string(Unpack(other + DockerImage({layer})).status().message()),
              HasSubstr("twice"));
}

// OCI's layout: blobs by their digests, and an index.
class OciLayout {
 public:
  Json Blob(const std::string& data, const std::string& kind) {
    members_ += TarEntry('0', "blobs/sha256/" + Sha256Hex(data), data);
    return {{"mediaType", kind}, {"digest", "sha256:" + Sha256Hex(data)}, {"size", data.size()}};
  }
  Json Manifest(const std::string& layer, const std::string& layer_kind = "application/vnd.oci.image.layer.v1.tar",
                const std::string& config_kind = "application/vnd.oci.image.config.v1+json",
                const std::string& processor = "amd64") {
    Json config = ImageConfigOf({layer});
    config["architecture"] = processor;
    const Json manifest = {{"schemaVersion", 2},
                           {"config", Blob(config.dump(), config_kind)},
                           {"layers", Json::array({Blob(layer, layer_kind)})}};
    return Blob(manifest.dump(), "application/vnd.oci.image.manifest.v1+json");
  }
  std::string Tar(const Json& manifests) const {
    const Json index = {{"schemaVersion", 2}, {"manifests", manifests}};
    return members_ + TarEntry('0', "index.json", index.dump()) +
           TarEntry('0', "oci-layout", R"({"imageLayoutVersion": "1.0.0"})") + EndOfTar();
  }

 private:
  std::string members_;
};

TEST_F(ImageFormsTest, OfAnIndexTheImageForMostProcessorsIsTaken) {
  const std::string usual = Layer(kRunEntry + TarEntry('0', "usual"));
  const std::string newer = Layer(kRunEntry + TarEntry('0', "newer"));
  OciLayout layout;
  const auto of = [](Json manifest, const char* variant) {
    manifest["platform"] = {{"os", "linux"}, {"architecture", "amd64"}};
    if (variant != nullptr) manifest["platform"]["variant"] = variant;
    return manifest;
  };
  const Json plain = layout.Manifest(usual), fast = layout.Manifest(newer);
  const Json signature = layout.Manifest("{}", "application/vnd.dev.cosign.simplesigning.v1+json");
  const Json bill = layout.Manifest("{}", "application/vnd.in-toto+json", "application/vnd.oci.empty.v1+json");
  for (const char* variant : {"v2", "v3", "v4"}) {
    for (const Json& list : {Json::array({of(plain, nullptr), of(fast, variant)}),
                             Json::array({of(fast, variant), of(plain, "v1"), signature, bill})}) {
      const auto image = Unpack(layout.Tar(list));
      ASSERT_TRUE(image.ok()) << image.status();
      EXPECT_TRUE(Has("usual"));
      EXPECT_FALSE(Has("newer"));
    }
  }
  EXPECT_TRUE(Unpack(layout.Tar({signature, plain, bill})).ok());
  EXPECT_THAT(std::string(Unpack(layout.Tar({of(plain, nullptr), of(fast, nullptr)})).status().message()),
              HasSubstr("lists 2 images"));
}

TEST_F(ImageFormsTest, EntriesOfAnIndexThatAreNotTakenMayBeAbsentOrOfAnyDigest) {
  const std::string layer = Layer(kRunEntry);
  OciLayout layout;
  const Json plain = layout.Manifest(layer);
  const Json arm_of_config = layout.Manifest(layer, "application/vnd.oci.image.layer.v1.tar",
                                             "application/vnd.oci.image.config.v1+json", "arm64");
  const auto absent = [](const std::string& digest, const Json& platform) {
    return Json{{"mediaType", "application/vnd.oci.image.manifest.v1+json"},
                {"digest", digest}, {"size", 5}, {"platform", platform}};
  };
  const std::string gone = "sha256:" + std::string(64, '0');
  const Json newer = absent(gone, {{"os", "linux"}, {"architecture", "amd64"}, {"variant", "v3"}});
  const Json arm = absent("sha512:" + std::string(128, '0'),
                          {{"os", "linux"}, {"architecture", "arm64"}});
  Json index = absent(gone, nullptr);
  index["mediaType"] = "application/vnd.oci.image.index.v1+json";
  for (const Json& other : {newer, arm, index, arm_of_config}) {
    for (const Json& list : {Json::array({other, plain}), Json::array({plain, other})}) {
      const auto image = Unpack(layout.Tar(list));
      EXPECT_TRUE(image.ok()) << other << image.status();
    }
  }
  const auto why = [&](const Json& only) {
    return std::string(Unpack(layout.Tar(Json::array({only}))).status().message());
  };
  EXPECT_THAT(why(newer), HasSubstr("which is not in the archive"));
  EXPECT_THAT(why(arm), HasSubstr("is for \"linux/arm64\""));
  EXPECT_THAT(why(arm_of_config), HasSubstr("is for \"linux/arm64\""));
}

TEST_F(ImageFormsTest, AnImageMayBeListedUnderSeveralNames) {
  const std::string layer = Layer(kRunEntry);
  const std::string other = Layer(kRunEntry + TarEntry('0', "other"));
  const std::string config = ImageConfigOf({layer}).dump();
  const auto unpacked = [&](const std::string& second) {
    const auto item = [](const char* tag, const char* file) {
      return Json::object({{"Config", "config.json"}, {"RepoTags", {tag}}, {"Layers", {file}}});
    };
    const Json manifest =
        Json::array({item("agent:1", "layer.tar"), item("agent:2", second.c_str())});
    return Unpack(TarEntry('0', "config.json", config) + TarEntry('0', "layer.tar", layer) +
                  TarEntry('0', "other.tar", other) + TarEntry('0', "manifest.json", manifest.dump()) +
                  EndOfTar());
  };
  ASSERT_TRUE(unpacked("layer.tar").ok()) << unpacked("layer.tar").status();
  EXPECT_EQ(unpacked("layer.tar")->manifest.name, "agent:1");
  EXPECT_THAT(std::string(unpacked("other.tar").status().message()), HasSubstr("lists 2 images"));
}

TEST_F(ImageFormsTest, LayersMayHaveFramesThatAreSkipped) {
  // As containers' tools write "zstd:chunked": frames of data, then frames for other readers.
  const std::string layer = Layer(kRunEntry + TarEntry('0', "data", std::string(300'000, 'd')));
  WritePacked(temp_ / "layer", layer, Kind::kTarZst);
  std::ostringstream packed;
  packed << std::ifstream(temp_ / "layer").rdbuf();
  const std::string skipped = std::string("\x50\x2a\x4d\x18\x04\0\0\0", 8) + "toc!";
  for (const std::string& stored : {packed.str() + skipped, skipped + packed.str(),
                                    packed.str() + skipped + skipped}) {
    OciLayout layout;
    const Json manifest = {
        {"schemaVersion", 2},
        {"config", layout.Blob(ImageConfigOf({layer}).dump(), "application/vnd.oci.image.config.v1+json")},
        {"layers", Json::array({layout.Blob(stored, "application/vnd.oci.image.layer.v1.tar+zstd")})}};
    const auto image =
        Unpack(layout.Tar(Json::array({layout.Blob(manifest.dump(), "application/vnd.oci.image.manifest.v1+json")})));
    ASSERT_TRUE(image.ok()) << image.status();
    EXPECT_TRUE(Has("data"));
  }
}

TEST_F(ImageFormsTest, WhatIsNoImageSaysWhatItIs) {
  const auto why = [&](const std::string& tar) { return std::string(Unpack(tar).status().message()); };
  EXPECT_THAT(why(TarEntry('0', ".dockerenv") + kRunEntry + EndOfTar()), HasSubstr("docker save"));
  EXPECT_THAT(why(TarEntry('0', "usr/bin/sh") + TarEntry('0', "etc/passwd") + EndOfTar()),
              HasSubstr("docker save"));
  EXPECT_THAT(why(TarEntry('0', "image/index.json", "{}") + TarEntry('0', "image/oci-layout", "{}") + EndOfTar()),
              HasSubstr("tar -C image"));
  EXPECT_THAT(why(TarEntry('0', "manifest.json", R"({"schemaVersion": 2})") +
                  TarEntry('0', "version", "Directory Transport Version: 1.1\n") + EndOfTar()),
              HasSubstr("skopeo copy IMAGE oci-archive:"));
  EXPECT_THAT(why(TarEntry('0', "blobs/sha256/0") + TarEntry('0', "index.json") + EndOfTar()),
              HasSubstr("lacks the file oci-layout"));
  WriteArchive(temp_ / "a", {{.path = "oci-layout"}, {.path = "index.json"}, {.path = "blobs/x"}},
               Kind::kZip);
  EXPECT_THAT(std::string(UnpackArtefact(temp_ / "a", temp_ / "zip", {}).status().message()),
              HasSubstr("OCI's layout"));
}

}  // namespace
}  // namespace myograde::server

// A submission's folder on its way to a node: the same files, modes, times and digest, whatever the
// participant called them; and nothing at all from a tar that is not the daemon's.
#include "server/artefact/artefact.h"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/artefact/image_builder.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kRunManifest[] = R"({"name": "a", "command": ["./run"]})";

class ArtefactStreamTest : public testing::Test {
 protected:
  // Unpacks an upload, as the daemon does.
  Artefact Accept(const std::string& upload) {
    WriteFile(temp_ / "upload", upload).IgnoreError();
    auto artefact = UnpackArtefact(temp_ / "upload", temp_ / "daemon", {});
    EXPECT_TRUE(artefact.ok()) << artefact.status();
    return *artefact;
  }
  // The tar of a folder.
  static absl::StatusOr<std::string> Stream(const std::string& folder, const std::string& digest) {
    std::string tar;
    const absl::Status status = StreamArtefact(folder, digest, [&](std::string_view bytes) {
      tar += bytes;
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return tar;
  }
  // As one line for each entry: type, mode, time of a file, path, content or target.
  static std::string Describe(const fs::path& folder) {
    std::map<std::string, std::string> lines;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      struct stat info;
      EXPECT_EQ(lstat(entry.path().c_str(), &info), 0);
      std::string line = std::to_string(info.st_mode);
      if (S_ISLNK(info.st_mode)) {
        line = "link " + fs::read_symlink(entry.path()).string();
      } else if (S_ISREG(info.st_mode)) {
        line += " " + std::to_string(info.st_mtime) + " " + *ReadFile(entry.path().string());
      }
      lines[entry.path().lexically_relative(folder).string()] = line;
    }
    std::string all;
    for (const auto& [path, line] : lines) all += path + ": " + line + "\n";
    return all;
  }
  void ExpectRoundTrip(const std::string& digest) {
    const auto tar = Stream(temp_ / "daemon", digest);
    ASSERT_TRUE(tar.ok()) << tar.status();
    ASSERT_EQ(Place(*tar, digest), absl::OkStatus());
    EXPECT_EQ(Describe(temp_ / "node"), Describe(temp_ / "daemon"));
    EXPECT_EQ(*Stream(temp_ / "node", digest), *tar);
  }
  // What happens with a tar of these bytes, which come in pieces.
  absl::Status Place(const std::string& bytes, const std::string& digest) {
    size_t at = 0;
    return PlaceStreamedArtefact(
        [&]() -> absl::StatusOr<std::string> {
          const std::string piece = bytes.substr(at, 1000);
          at += piece.size();
          return piece;
        },
        digest, temp_ / "node");
  }

  const TestFolder temp_;
};

TEST_F(ArtefactStreamTest, ASubmissionArrivesAsItLeft) {
  const std::string long_name(200, 'n');
  const Artefact artefact = Accept(
      TarEntry('0', "policy.json", kRunManifest) + TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) +
      TarEntry('5', "empty/") + TarEntry('0', "-rf", "a dash") +
      TarEntry('0', "deep/er/caf\xc3\xa9 \"quoted\" %s", "text") + TarEntry('0', "zeros", "") +
      TarEntry('2', "python", {}, "/usr/bin/python3") +
      PaxHeader("path", "deep/" + long_name) + TarEntry('0', "x", "long") +
      TarEntry('0', "large", std::string(700'001, 'L')) + std::string(1024, '\0'));
  ExpectRoundTrip(artefact.digest);
}

TEST_F(ArtefactStreamTest, AnImageArrivesAsItLeft) {
  const Artefact artefact = Accept(DockerImage(
      {Layer(TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + TarEntry('5', "usr/lib/") +
             TarEntry('2', "lib", {}, "usr/lib") + TarEntry('2', "usr/up", {}, "../../../etc") +
             TarEntry('0', "etc/passwd", "root:x:0:0::/:/bin/sh\n"))}));
  EXPECT_TRUE(fs::is_symlink(temp_ / "daemon/image/usr/up"));
  ExpectRoundTrip(artefact.digest);
}

TEST_F(ArtefactStreamTest, AFolderThatIsNotTheArtefactIsNotPacked) {
  const Artefact artefact =
      Accept(TarEntry('0', "policy.json", kRunManifest) +
             TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'));
  ASSERT_TRUE(WriteFile(temp_ / "daemon/run", "#!/bin/sx\n").ok());
  EXPECT_TRUE(absl::IsDataLoss(Stream(temp_ / "daemon", artefact.digest).status()));
  ASSERT_EQ(mkfifo((temp_ / "daemon/pipe").c_str(), 0644), 0);
  EXPECT_TRUE(absl::IsDataLoss(Stream(temp_ / "daemon", artefact.digest).status()));
  EXPECT_FALSE(Stream(temp_ / "none", artefact.digest).ok());
}

TEST_F(ArtefactStreamTest, OnlyTheWholeArtefactIsPlaced) {
  const Artefact artefact =
      Accept(TarEntry('0', "policy.json", kRunManifest) +
             TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'));
  const auto tar = Stream(temp_ / "daemon", artefact.digest);
  ASSERT_TRUE(tar.ok()) << tar.status();
  EXPECT_TRUE(absl::IsDataLoss(Place(*tar, std::string(64, '0'))));
  EXPECT_FALSE(fs::exists(temp_ / "node"));
  EXPECT_TRUE(absl::IsDataLoss(Place(tar->substr(0, tar->size() / 2), artefact.digest)));
  EXPECT_FALSE(fs::exists(temp_ / "node"));
}

TEST_F(ArtefactStreamTest, TheErrorsOfBothEndsAreHandedOn) {
  const Artefact artefact =
      Accept(TarEntry('0', "policy.json", kRunManifest) +
             TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'));
  const auto gone = [](auto&&...) { return absl::CancelledError("gone"); };
  EXPECT_TRUE(absl::IsCancelled(StreamArtefact(temp_ / "daemon", artefact.digest, gone)));
  EXPECT_TRUE(absl::IsCancelled(PlaceStreamedArtefact(gone, artefact.digest, temp_ / "node")));
  EXPECT_FALSE(fs::exists(temp_ / "node"));
}

TEST_F(ArtefactStreamTest, NothingIsMadeOutsideTheFolder) {
  ASSERT_TRUE(fs::create_directory(temp_ / "outside"));
  const std::string end(1024, '\0');
  const std::string outside = temp_ / "outside";
  for (const std::string& bytes :
       {TarEntry('0', "../outside/x", "x") + end, TarEntry('0', outside + "/x", "x") + end,
        TarEntry('2', "a", {}, outside) + TarEntry('0', "a/x", "x") + end,
        TarEntry('2', "a", {}, "..") + TarEntry('0', "a/outside/x", "x") + end,
        TarEntry('5', "b/") + TarEntry('1', "b/x", {}, "../outside/x") + end,
        TarEntry('6', "pipe") + end, TarEntry('0', "twice", "1") + TarEntry('0', "twice", "2") + end,
        std::string("no tar"), std::string()}) {
    EXPECT_FALSE(Place(bytes, std::string(64, '0')).ok());
    EXPECT_TRUE(fs::is_empty(temp_ / "outside"));
    EXPECT_FALSE(fs::exists(temp_ / "node"));
  }
}

}  // namespace
}  // namespace myograde::server

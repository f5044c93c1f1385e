// Container images as submissions: layers, whiteouts, links, digests, users, and lies about them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "protocol/base/sha256.h"
#include "server/artefact/artefact.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/share_files.h"
#include "server/artefact/unpack_process.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/artefact/image_builder.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using Json = nlohmann::json;

const std::string kRun = TarEntry('0', "run", "#!/bin/sh\n", {}, 0755);

class ImageTest : public ::testing::Test {
 protected:
  absl::StatusOr<Artefact> Unpack(const std::string& archive, const ArtefactLimits& limits = {}) {
    std::ofstream(temp_ / "a") << archive;
    fs::remove_all(temp_ / "out");
    return UnpackArtefact(temp_ / "a", temp_ / "out", limits);
  }
  absl::StatusOr<Artefact> UnpackLayers(const std::vector<std::string>& entries) {
    std::vector<std::string> layers;
    for (const std::string& one : entries) layers.push_back(Layer(one));
    return Unpack(DockerImage(layers));
  }
  std::string Why(const std::vector<std::string>& entries) {
    const auto artefact = UnpackLayers(entries);
    EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
    EXPECT_FALSE(fs::exists(temp_ / "out"));
    return std::string(artefact.status().message());
  }
  std::string At(const std::string& path) { return temp_ / ("out/image/" + path); }
  bool Has(const std::string& path) { return fs::exists(fs::symlink_status(At(path))); }
  std::string TextOf(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(At(path)).rdbuf();
    return text.str();
  }

  const TestFolder temp_;
};

TEST_F(ImageTest, LayersWhiteoutsAndLinksGiveTheTreeThatEnginesShow) {
  const auto artefact = UnpackLayers(
      {kRun + TarEntry('5', "usr/lib/") + TarEntry('2', "lib", {}, "usr/lib") +
           TarEntry('0', "usr/lib/old", "old") + TarEntry('0', "data/a", "a") +
           TarEntry('0', "data/b", "b") + TarEntry('0', "gone/x", "x") +
           TarEntry('0', "file", "file"),
       // Through a link of the lower layer, as engines follow it.
       TarEntry('0', "lib/new", "new") + TarEntry('0', "lib/.wh.old") +
           TarEntry('0', "data/c", "c") + TarEntry('0', "data/.wh..wh..opq") +
           TarEntry('0', ".wh.gone") + TarEntry('0', "file/inside", "now a folder", {}, 0644)});
  // "file" is a file, and a layer can't put something below it without replacing it first.
  EXPECT_THAT(std::string(artefact.status().message()), HasSubstr("is below"));
  const auto good = UnpackLayers(
      {kRun + TarEntry('5', "usr/lib/") + TarEntry('2', "lib", {}, "usr/lib") +
           TarEntry('0', "usr/lib/old", "old") + TarEntry('0', "data/a", "a") +
           TarEntry('0', "data/sub/b", "b") + TarEntry('0', "gone/x", "x") +
           TarEntry('0', "file", "file"),
       TarEntry('0', "lib/new", "new") + TarEntry('0', "lib/.wh.old") +
           TarEntry('0', "data/c", "c") + TarEntry('0', "data/.wh..wh..opq") +
           TarEntry('0', ".wh.gone") + TarEntry('5', "file/") +
           TarEntry('0', "file/inside", "now a folder") + TarEntry('1', "two", {}, "usr/lib/new"),
       TarEntry('0', "usr/lib/new", "newer")});
  ASSERT_TRUE(good.ok()) << good.status();
  EXPECT_EQ(TextOf("usr/lib/new"), "newer");
  EXPECT_EQ(TextOf("two"), "new") << "a hard link is a copy of its time";
  EXPECT_FALSE(Has("usr/lib/old"));
  EXPECT_FALSE(Has("data/a"));
  EXPECT_FALSE(Has("data/sub"));
  EXPECT_EQ(TextOf("data/c"), "c") << "an opaque folder keeps what its own layer has";
  EXPECT_FALSE(Has("gone"));
  EXPECT_EQ(TextOf("file/inside"), "now a folder");
  EXPECT_EQ(fs::read_symlink(At("lib")), "usr/lib");
  for (const auto& entry : fs::recursive_directory_iterator(temp_ / "out")) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".wh.")) << entry.path();
  }
}

TEST_F(ImageTest, WhiteoutsConcernLowerLayersOnlyAndNoMoreThanTheyName) {
  const auto artefact = UnpackLayers({kRun + TarEntry('0', "a/x", "1") + TarEntry('0', "a-b", "1"),
                                      TarEntry('0', "a/y", "2") + TarEntry('0', ".wh.a") +
                                          TarEntry('0', ".wh.nothing") +
                                          TarEntry('0', ".wh..wh.plnk")});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  EXPECT_FALSE(Has("a/x"));
  EXPECT_TRUE(Has("a/y"));
  EXPECT_TRUE(Has("a-b"));
  // All of the lower layers.
  ASSERT_TRUE(UnpackLayers({TarEntry('0', "low/x", "1"), kRun + TarEntry('0', ".wh..wh..opq")}).ok());
  EXPECT_TRUE(Has("run"));
  EXPECT_FALSE(Has("low"));
  for (const char* none : {".wh.", ".wh..", "a/.wh...", ".wh.."}) {
    EXPECT_THAT(Why({kRun + TarEntry('0', "a/x", "1"), TarEntry('0', none)}),
                HasSubstr("removes no name"));
  }
}

TEST_F(ImageTest, NothingLeavesTheImage) {
  const std::string victim = temp_ / "victim";
  fs::create_directory(victim);
  std::ofstream(victim + "/file") << "untouched";
  std::string climb;
  for (int i = 0; i < 30; ++i) climb += "../";
  // Links are kept, followed within the image, and never by the file system.
  const auto artefact = UnpackLayers(
      {kRun + TarEntry('2', "out", {}, victim) + TarEntry('2', "up", {}, climb + "etc") +
           TarEntry('2', "there", {}, "/var/lib") +
           TarEntry('2', "self", {}, "self"),
       TarEntry('0', "out/file", "written") + TarEntry('0', "up/shadow", "mine") +
           TarEntry('0', "there/file", "written") +
           TarEntry('0', "out/.wh.file2") + TarEntry('1', "copy", {}, "up/shadow")});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  std::ostringstream text;
  text << std::ifstream(victim + "/file").rdbuf();
  EXPECT_EQ(text.str(), "untouched");
  EXPECT_EQ(TextOf("var/lib/file"), "written");
  EXPECT_FALSE(Has("tmp")) << "the victim's place in the image is not kept";
  EXPECT_EQ(TextOf("etc/shadow"), "mine");
  EXPECT_EQ(TextOf("copy"), "mine");
  EXPECT_THAT(Why({kRun + TarEntry('0', "../x", "x")}), HasSubstr("\"..\""));
  EXPECT_THAT(Why({kRun + TarEntry('2', "self", {}, "self"), TarEntry('0', "self/x", "x")}),
              HasSubstr("loop of symbolic links"));
  EXPECT_THAT(Why({kRun + TarEntry('1', "copy", {}, victim + "/file")}), HasSubstr("not a file of the"));
  EXPECT_THAT(Why({kRun + TarEntry('1', "copy", {}, "../../etc/passwd")}), HasSubstr("\"..\""));
}

TEST_F(ImageTest, WhatTheSandboxReplacesIsLeftOutAndTheRestIsMadeHarmless) {
  const auto artefact = UnpackLayers(
      {kRun + TarEntry('0', "proc/version", "x") + TarEntry('3', "dev/null") +
       TarEntry('0', "tmp/x", "x") + TarEntry('0', "myograde/myograde-bridge", "evil", {}, 0755) +
       TarEntry('0', "tool", "x", {}, 04755) + TarEntry('5', "shared/", {}, {}, 03777) +
       TarEntry('0', "etc/resolv.conf", "nameserver 8.8.8.8") +
       TarEntry('2', "etc/hosts", {}, "/etc/passwd") + TarEntry('0', "policy/x", "x")});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  for (const char* gone : {"proc", "dev", "tmp", "myograde", "etc/resolv.conf"}) {
    EXPECT_FALSE(Has(gone)) << gone;
  }
  EXPECT_TRUE(Has("policy/x"));
  EXPECT_THAT(TextOf("etc/hosts"), HasSubstr("127.0.0.1 localhost"));
  struct stat info = {};
  ASSERT_EQ(::stat(At("tool").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0755u);
  ASSERT_EQ(::stat(At("shared").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0755u);
  EXPECT_THAT(Why({kRun + TarEntry('3', "disk")}), HasSubstr("device node"));
  EXPECT_THAT(Why({kRun + TarEntry('6', "pipe")}), HasSubstr("named pipe"));
  EXPECT_THAT(Why({kRun + TarEntry('0', "etc/ld.so.preload", "/evil.so")}),
              HasSubstr("ld.so.preload"));
  EXPECT_THAT(Why({kRun + TarEntry('2', "etc", {}, "other")}), HasSubstr("must be a folder"));
  EXPECT_THAT(Why({kRun + TarEntry('2', "e", {}, "/dev"), TarEntry('1', "x", {}, "e/null")}),
              HasSubstr("not a file of the image"));
}

TEST_F(ImageTest, LiesAboutDigestsSizesAndLayersAreFound) {
  const std::string layer = Layer(kRun);
  const Json config = ImageConfigOf({layer});
  const auto why = [&](const std::string& archive) {
    return std::string(Unpack(archive).status().message());
  };
  EXPECT_THAT(why(DockerImage({layer}, config, {Layer(kRun + TarEntry('0', "more", "x"))})),
              HasSubstr("different content"));
  EXPECT_THAT(why(DockerImage({layer}, config, {layer + "more"})), HasSubstr("different content"));
  EXPECT_THAT(why(DockerImage({layer}, config, {"no tar at all" + std::string(5000, 'x')})),
              HasSubstr("the image's layer"));
  EXPECT_THAT(why(DockerImage({layer, layer + layer}, config)), HasSubstr("2 layers"));
  Json foreign = config;
  foreign["architecture"] = "arm64";
  EXPECT_THAT(why(DockerImage({layer}, foreign)), HasSubstr("linux/arm64"));
  Json nothing = config;
  nothing["config"] = Json::object();
  EXPECT_THAT(why(DockerImage({layer}, nothing)), HasSubstr("neither ENTRYPOINT nor CMD"));
  Json many = config;
  many["config"]["Env"] = std::vector<std::string>(9, "A=" + std::string(5000, 'x'));
  EXPECT_THAT(why(DockerImage({layer}, many)), HasSubstr("bytes of them"));
  for (const char* bad : {"sha256:zz", "md5:0", "sha512:00"}) {
    Json other = config;
    other["rootfs"]["diff_ids"] = {bad};
    EXPECT_THAT(why(DockerImage({layer}, other)), HasSubstr("only SHA-256"));
  }
  // The whole archive, cut anywhere, is one sentence and leaves nothing.
  const std::string whole = DockerImage({layer});
  for (size_t size = 512; size + 512 < whole.size(); size += 1111) {
    EXPECT_FALSE(Unpack(whole.substr(0, size)).ok()) << size;
    EXPECT_FALSE(fs::exists(temp_ / "out"));
  }
}

TEST_F(ImageTest, LimitsCountWhatLayersWriteEvenIfItIsRemovedAgain) {
  const std::string big = TarEntry('0', "big", std::string(60'000, 'x'));
  const std::vector<std::string> layers = {Layer(kRun + big), Layer(TarEntry('0', ".wh.big")),
                                           Layer(big)};
  EXPECT_TRUE(Unpack(DockerImage(layers), {.bytes = 200'000}).ok());
  EXPECT_THAT(std::string(Unpack(DockerImage(layers), {.bytes = 100'000}).status().message()),
              HasSubstr("larger than 100000 bytes"));
  std::string entries = kRun;
  for (int i = 0; i < 60; ++i) entries += TarEntry('0', "f" + std::to_string(i));
  EXPECT_THAT(std::string(Unpack(DockerImage({Layer(entries)}), {.files = 50}).status().message()),
              HasSubstr("more than 50"));
  std::string again;
  for (int i = 0; i < 60; ++i) again += TarEntry('0', "same", "x");
  EXPECT_FALSE(Unpack(DockerImage({Layer(kRun + again)}), {.files = 20}).ok())
      << "headers count too";
  std::string deep;
  for (int i = 0; i < 40; ++i) deep += "d/";
  EXPECT_FALSE(Unpack(DockerImage({Layer(kRun + TarEntry('0', deep + "x", "x"))}),
                      {.depth = 20}).ok());
  std::string tops = kRun;
  for (int i = 0; i < 200; ++i) tops += TarEntry('0', "top" + std::to_string(i));
  EXPECT_THAT(std::string(Unpack(DockerImage({Layer(tops)})).status().message()),
              HasSubstr("group them into folders"));
}

TEST_F(ImageTest, UserWorkingFolderAndEnvironmentAreTheImages) {
  const std::string layer =
      Layer(kRun + TarEntry('0', "etc/passwd", "root:x:0:0::/:\napp:x:1234:77::/:\nbroken\n") +
            TarEntry('0', "etc/group", "video:x:44:\n") + TarEntry('2', "w", {}, "srv/work"));
  const auto unpack = [&](const Json& config) {
    return Unpack(DockerImage({layer}, ImageConfigOf({layer}, config)));
  };
  auto artefact = unpack({{"Entrypoint", {"/run"}}, {"Cmd", {"fast"}}, {"User", "app:video"},
                          {"WorkingDir", "/w/here"},
                          {"Env", {"A=1", "A=2", "HOME=/root", "MYOGRADE_LCM_URL=x", "=", "B"}}});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  ASSERT_TRUE(artefact->manifest.image.has_value());
  EXPECT_EQ(artefact->manifest.name, "agent");
  EXPECT_EQ(artefact->manifest.command, (std::vector<std::string>{"/run", "fast"}));
  EXPECT_EQ(*artefact->manifest.image,
            (PolicyImage{{{"A", "2"}}, "/srv/work/here", 1234, 44}));
  EXPECT_TRUE(fs::is_directory(At("srv/work/here")));
  artefact = unpack({{"Entrypoint", {"/run"}}, {"User", "root"}});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  EXPECT_EQ(*artefact->manifest.image, (PolicyImage{.environment = {{"HOME", "/"}}})) << "no policy is root";
  EXPECT_EQ(unpack({{"Entrypoint", {"/run"}}, {"User", "77:0"}})->manifest.image->uid, 77);
  for (const char* unknown : {"nobody-knows", "-1", "99999999999", "app:none", "broken"}) {
    const auto refused = unpack({{"Entrypoint", {"/run"}}, {"User", unknown}});
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr("is not in its /etc/"))
        << unknown;
  }
  EXPECT_EQ(unpack({{"Entrypoint", {"/run"}}, {"User", "app"}})->manifest.image->environment,
            (std::map<std::string, std::string>{{"HOME", "/"}}));
  for (const char* folder : {"relative", "/proc/self", "/run"}) {
    EXPECT_FALSE(unpack({{"Entrypoint", {"/run"}}, {"WorkingDir", folder}}).ok()) << folder;
  }
  std::string deep;
  while (deep.size() < 5000) deep += "/" + std::string(200, 'd');
  EXPECT_TRUE(absl::IsInvalidArgument(
      unpack({{"Entrypoint", {"/run"}}, {"WorkingDir", deep}}).status())) << "not a trouble of the host";
}

TEST_F(ImageTest, HomeIsThatOfTheImage) {
  const std::string layer = Layer(
      kRun + TarEntry('0', "root/.cache/weights", "w") + TarEntry('0', "home/app/.cache/weights", "w") +
      TarEntry('0', "opt/own/x", "x") + TarEntry('2', "link", {}, "opt/own") +
      TarEntry('0', "etc/passwd", "root:x:0:0::/root:/bin/sh\napp:x:1000:1000::/home/app:/bin/sh\n"
                                  "gone:x:1001:1001::/home/gone:/bin/sh\n"));
  const auto home = [&](const std::string& user, const Json& variables) {
    const auto artefact = Unpack(DockerImage(
        {layer}, ImageConfigOf({layer}, {{"Entrypoint", {"/run"}}, {"User", user}, {"Env", variables}})));
    EXPECT_TRUE(artefact.ok()) << artefact.status();
    const auto& environment = artefact->manifest.image->environment;
    return environment.contains("HOME") ? environment.at("HOME") : "";
  };
  EXPECT_EQ(home("", Json::array()), "/root");
  EXPECT_EQ(home("0", Json::array()), "/root");
  EXPECT_EQ(home("app", Json::array()), "/home/app");
  EXPECT_EQ(home("1000:1000", Json::array()), "/home/app");
  EXPECT_EQ(home("app", {"HOME=/opt/own"}), "/opt/own");
  EXPECT_EQ(home("app", {"HOME=/link"}), "/link");
  for (const char* none : {"/nowhere", "relative", "/opt/own/x", "/proc", ""}) {
    EXPECT_EQ(home("app", {std::string("HOME=") + none}), "") << none;
  }
  EXPECT_EQ(home("gone", Json::array()), "");
  std::string dots = "/etc";
  while (dots.size() < 5000) dots += "/.";
  const std::string deep = Layer(kRun + TarEntry('0', "etc/passwd", "bob:x:1000:1000::" + dots + ":/bin/sh\n"));
  EXPECT_THAT(Unpack(DockerImage({deep}, ImageConfigOf({deep}, {{"Entrypoint", {"/run"}}, {"User", "bob"}})))
                  .status().ToString(),
              HasSubstr("bytes; at most"));
  EXPECT_EQ(home("77", Json::array()), "/") << "as engines have it for a user that is not in passwd";
}

TEST_F(ImageTest, AFolderWithAnImageIsTheSameArtefactWhereverItIsUnpacked) {
  const std::string layer = Layer(kRun);
  fs::create_directory(temp_ / "p");
  std::ofstream(temp_ / "p/my.tar") << DockerImage({layer});
  std::ofstream(temp_ / "p/policy.json") << R"({"name": "agent", "image": "my.tar"})";
  ASSERT_TRUE(PackArtefact(temp_ / "p", temp_ / "packed", {}).ok());
  const auto folder = UnpackInProcess(
      temp_ / "packed", temp_ / "apart", {},
      {.time = absl::Seconds(60), .memory_bytes = 256 << 20});
  ASSERT_TRUE(folder.ok()) << folder.status();
  // The bare archive has the same name, from its tag.
  const auto bare = Unpack(DockerImage({layer}));
  ASSERT_TRUE(bare.ok()) << bare.status();
  EXPECT_EQ(folder->digest, bare->digest);
  EXPECT_EQ(folder->manifest.image, bare->manifest.image);
  ASSERT_TRUE(PackArtefact(temp_ / "p/my.tar", temp_ / "packed", {}).ok());
  EXPECT_EQ(UnpackArtefact(temp_ / "packed", temp_ / "again", {})->digest, bare->digest);
  // Compressed as a whole.
  WritePacked(temp_ / "a", DockerImage({layer}), Kind::kTarGz);
  const auto packed = UnpackArtefact(temp_ / "a", temp_ / "gz", {});
  ASSERT_TRUE(packed.ok()) << packed.status();
  EXPECT_EQ(packed->digest, bare->digest);
  // A command and variables of policy.json come over the image's.
  std::ofstream(temp_ / "p/policy.json")
      << R"({"name": "b", "image": "my.tar", "command": ["/run", "x"], "env": {"POLICY_A": "1"}})";
  ASSERT_TRUE(PackArtefact(temp_ / "p", temp_ / "packed", {}).ok());
  const auto own = UnpackArtefact(temp_ / "packed", temp_ / "own", {});
  ASSERT_TRUE(own.ok()) << own.status();
  EXPECT_EQ(own->manifest.command.size(), 2u);
  EXPECT_EQ(own->manifest.environment.at("POLICY_A"), "1");
  for (const char* text :
       {R"({"name": "b", "image": "../my.tar"})", R"({"name": "b", "image": "none.tar"})",
        R"({"name": "b", "image": {"uid": 0}})", R"({"name": "b", "image": ""})"}) {
    std::ofstream(temp_ / "p/policy.json") << text;
    EXPECT_TRUE(absl::IsInvalidArgument(PackArtefact(temp_ / "p", temp_ / "packed", {}).status())) << text;
  }
  std::ofstream(temp_ / "p/policy.json") << R"({"name": "b", "image": "my.tar"})";
  std::ofstream(temp_ / "p/weights") << "x";
  EXPECT_THAT(std::string(PackArtefact(temp_ / "p", temp_ / "packed", {}).status().message()),
              HasSubstr("put it into the image"));
}

TEST_F(ImageTest, AnOrdinarySubmissionThatLooksLikeAnImageIsNone) {
  const std::string policy = TarEntry('0', "policy.json", R"({"name": "n", "command": ["./run"]})");
  const auto artefact = Unpack(TarEntry('0', "blobs/weights", "w") +
                               TarEntry('0', "manifest.json", "[]") + policy + kRun + EndOfTar());
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  EXPECT_FALSE(artefact->manifest.image.has_value());
}

TEST_F(ImageTest, EqualFilesOfImagesAreKeptOnceUntilNobodyUsesThem) {
  const std::string big(20'000, 'x');
  const std::string pool = temp_ / "pool";
  const std::string layer = Layer(kRun + TarEntry('0', "big", big) + TarEntry('0', "two", big) +
                                  TarEntry('0', "tool", big, {}, 0755) +
                                  TarEntry('0', "small", "x") + TarEntry('2', "l", {}, "/etc/passwd"));
  for (const char* name : {"one", "other"}) {
    ASSERT_TRUE(Unpack(DockerImage({layer})).ok());
    fs::rename(temp_ / "out", temp_ / name);
    ASSERT_TRUE(ShareImage(temp_ / name, pool).ok());
  }
  struct stat info = {};
  ASSERT_EQ(::stat((temp_ / "one/image/big").c_str(), &info), 0);
  EXPECT_EQ(info.st_nlink, 5u) << "two names in each of two images, and the pool's";
  struct stat tool = {};
  ASSERT_EQ(::stat((temp_ / "other/image/tool").c_str(), &tool), 0);
  EXPECT_EQ(tool.st_nlink, 3u);
  EXPECT_NE(tool.st_ino, info.st_ino) << "another mode";
  EXPECT_EQ(tool.st_mode & 07777, 0755u);
  EXPECT_EQ(fs::hard_link_count(temp_ / "one/image/small"), 1u);
  const int64_t whole = DiskBytes(temp_ / "one") + DiskBytes(temp_ / "other");
  EXPECT_GE(whole, 40'000);
  EXPECT_LT(whole, 42'000) << "each byte on the disk counts once";
  EXPECT_EQ(SweepPool(pool), 0);
  fs::remove_all(temp_ / "one");
  EXPECT_EQ(SweepPool(pool), 0);
  EXPECT_GE(DiskBytes(temp_ / "other"), 40'000);
  fs::remove_all(temp_ / "other");
  EXPECT_EQ(SweepPool(pool), 40'000);
  EXPECT_TRUE(fs::is_empty(pool));
}

}  // namespace
}  // namespace myograde::server

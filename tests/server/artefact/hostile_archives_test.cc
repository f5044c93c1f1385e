// Hostile archives. Each is rejected with one sentence, in bounded time, and leaves nothing behind,
// inside or outside.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "server/artefact/artefact.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr char kOwnManifest[] = R"({"name": "walker", "command": ["./policy"]})";
// Generous for a slow host with sanitizers; without limits these take minutes.
constexpr std::chrono::seconds kSoon{30};

std::string Honest() {
  return TarEntry('0', "policy.json", kOwnManifest) + TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755);
}
std::string End() { return std::string(2 * kTarBlock, '\0'); }

void WriteBytes(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string ReadBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Unpacks the file "a" of `temp`; returns the error message, "" if there is none.
std::string Refusal(const TestFolder& temp, const ArtefactLimits& limits = {}) {
  WriteBytes(temp / "canary", "untouched");
  const auto start = std::chrono::steady_clock::now();
  const absl::StatusOr<Artefact> artefact = UnpackArtefact(temp / "a", temp / "out", limits);
  EXPECT_LT(std::chrono::steady_clock::now() - start, kSoon);
  EXPECT_EQ(ReadBytes(temp / "canary"), "untouched");
  EXPECT_EQ(std::distance(fs::directory_iterator(temp.path()), {}), artefact.ok() ? 3 : 2);
  if (artefact.ok()) return "";
  EXPECT_EQ(artefact.status().code(), absl::StatusCode::kInvalidArgument) << artefact.status();
  std::string sentence(artefact.status().message());
  EXPECT_EQ(sentence.find('\n'), std::string::npos) << sentence;
  return sentence;
}

std::string RefusalOf(std::string_view bytes, const ArtefactLimits& limits = {}) {
  const TestFolder temp;
  WriteBytes(temp / "a", bytes);
  return Refusal(temp, limits);
}

// A valid submission followed by raw tar blocks.
std::string RefusalOfEntry(const std::string& blocks, const ArtefactLimits& limits = {}) {
  return RefusalOf(Honest() + blocks + End(), limits);
}

std::string RefusalOfPacked(std::string_view bytes, Kind kind, const ArtefactLimits& limits = {}) {
  const TestFolder temp;
  WritePacked(temp / "a", bytes, kind);
  return Refusal(temp, limits);
}

std::string RefusalOfWritten(std::vector<Raw> entries, Kind kind,
                             const ArtefactLimits& limits = {}) {
  const TestFolder temp;
  entries.insert(entries.begin(), {{.path = "policy.json", .content = kOwnManifest},
                                   {.path = "policy", .content = "x", .mode = AE_IFREG | 0755}});
  WriteArchive(temp / "a", entries, kind);
  return Refusal(temp, limits);
}

TEST(HostileArchives, AnHonestOneMadeByHandIsTaken) { EXPECT_EQ(RefusalOfEntry(""), ""); }

TEST(HostileArchives, ClaimsAreRefusedBeforeTheyAreReadOut) {
  // A plain header can state at most 8 GiB; extended headers any size.
  EXPECT_THAT(RefusalOfEntry(TarHeader('0', "big", "", 0644, 077777777777)),
              HasSubstr("larger than 4294967296 bytes in total, unpacked (at \"big\")"));
  EXPECT_THAT(RefusalOfEntry(PaxHeader("size", "10000000000") + TarHeader('0', "big", "", 0644, 0)),
              HasSubstr("larger than"));
  EXPECT_NE(RefusalOfEntry(PaxHeader("size", "9223372036854775807") + TarEntry('0', "big")), "");
  EXPECT_NE(RefusalOfEntry(PaxHeader("size", "-1") + TarEntry('0', "big")), "");
}

TEST(HostileArchives, SparseFilesCountWithTheirGaps) {
  EXPECT_THAT(RefusalOfEntry(PaxHeader("GNU.sparse.size", "10737418240") + TarEntry('0', "holes")),
              HasSubstr("larger than"));
  EXPECT_THAT(RefusalOfEntry(PaxHeader("GNU.sparse.size", "1048576") + TarEntry('0', "holes"),
                             {.bytes = 65536}),
              HasSubstr("larger than 65536 bytes"));
}

TEST(HostileArchives, BombsStopAtTheLimit) {
  const std::string zeros(64 << 20, '\0');
  for (const Kind kind : {Kind::kTarGz, Kind::kTarZst, Kind::kZip}) {
    EXPECT_THAT(RefusalOfWritten({{.path = "bomb", .content = zeros}}, kind, {.bytes = 1 << 20}),
                HasSubstr("larger than 1048576 bytes in total, unpacked (at \"bomb\")"));
  }
}

TEST(HostileArchives, AZipThatHoldsMoreThanItSaysStopsAtTheLimit) {
  const TestFolder temp;
  WriteArchive(temp / "a", {{.path = "policy.json", .content = kOwnManifest},
                            {.path = "bomb", .content = std::string(8 << 20, '\0')}}, Kind::kZip);
  std::string bytes = ReadBytes(temp / "a");
  const std::string honest("\0\0\x80\0", 4), lie("\1\0\0\0", 4);
  int changed = 0;
  for (size_t at = 0; (at = bytes.find(honest, at)) != std::string::npos; ++changed) {
    bytes.replace(at, lie.size(), lie);
  }
  ASSERT_GE(changed, 1);
  EXPECT_THAT(RefusalOf(bytes, {.bytes = 1 << 20}),
              AnyOf(HasSubstr("larger"), HasSubstr("broken")));
}

TEST(HostileArchives, OneLayerOfCompressionIsEnough) {
  const TestFolder temp;
  WritePacked(temp / "once", Honest() + End(), Kind::kTarGz);
  const std::string once = ReadBytes(temp / "once");
  EXPECT_EQ(RefusalOf(once), "");
  EXPECT_THAT(RefusalOfPacked(once, Kind::kTarGz), HasSubstr("compressed more than once"));
  EXPECT_NE(RefusalOfPacked(once, Kind::kTarZst), "");
}

TEST(HostileArchives, GzipInSeveralMembersIsStillOneArchive) {
  const TestFolder temp;
  const std::string tar = Honest() + End();
  WritePacked(temp / "one", tar.substr(0, 700), Kind::kTarGz);
  WritePacked(temp / "two", tar.substr(700), Kind::kTarGz);
  EXPECT_EQ(RefusalOf(ReadBytes(temp / "one") + ReadBytes(temp / "two")), "");
}

TEST(HostileArchives, TenMillionEntriesAreRefusedAtTheLimit) {
  // 20,000 entries in a few hundred bytes, 500 times over.
  const TestFolder temp;
  std::string block;
  for (int i = 0; i < 20'000; ++i) block += TarHeader('5', "./", "", 0755, 0);
  WritePacked(temp / "part", block, Kind::kTarGz);
  const std::string part = ReadBytes(temp / "part");
  std::string all;
  for (int i = 0; i < 500; ++i) all += part;
  EXPECT_THAT(RefusalOf(all), HasSubstr("more than 200000 files, folders and links"));
  // The same with distinct names.
  std::string names;
  for (int i = 0; i < 100'000; ++i) names += TarHeader('0', std::to_string(i), "", 0644, 0);
  EXPECT_THAT(RefusalOfPacked(names, Kind::kTarGz, {.files = 1000}),
              HasSubstr("more than 1000 files, folders and links (at \"1000\")"));
  std::vector<Raw> zipped(3000);
  for (size_t i = 0; i < zipped.size(); ++i) zipped[i].path = std::to_string(i);
  EXPECT_THAT(RefusalOfWritten(zipped, Kind::kZip, {.files = 1000}), HasSubstr("more than 1000"));
}

TEST(HostileArchives, SpecialBitsAndKinds) {
  for (const uint32_t mode : {04755u, 02755u, 06755u, 01755u}) {
    const char* name = mode == 01755u ? "sticky bit; remove it" : "setuid or setgid bit; remove it";
    EXPECT_THAT(RefusalOfEntry(TarEntry('0', "bits", "x", "", mode)), HasSubstr(name));
    EXPECT_THAT(RefusalOfEntry(TarEntry('5', "bits/", "", "", mode)), HasSubstr(name));
  }
  EXPECT_THAT(RefusalOfEntry(TarEntry('1', "hard", "", "policy")), HasSubstr("is a hard link"));
  EXPECT_THAT(RefusalOfEntry(TarEntry('1', "hard", "", "/etc/shadow")),
              HasSubstr("is a hard link"));
  EXPECT_THAT(RefusalOfEntry(TarEntry('3', "null")), HasSubstr("a device node"));
  EXPECT_THAT(RefusalOfEntry(TarEntry('4', "disk")), HasSubstr("a device node"));
  EXPECT_THAT(RefusalOfEntry(TarEntry('6', "pipe")), HasSubstr("a named pipe"));
}

TEST(HostileArchives, NamesThatPlayTricks) {
  EXPECT_THAT(RefusalOfEntry(TarEntry('0', "two\nlines")),
              HasSubstr("\"two?lines\" has a control"));
  EXPECT_THAT(RefusalOfEntry(TarEntry('0', "\x1b[2J")), HasSubstr("control character"));
  EXPECT_NE(RefusalOfEntry(TarEntry('0', "bad\xff\xfe")), "");
  EXPECT_NE(RefusalOfEntry(PaxHeader("hdrcharset", "BINARY") + TarEntry('0', "bad\xc3(")), "");
  EXPECT_THAT(RefusalOfEntry(PaxHeader("path", std::string(256, 'n')) + TarEntry('0', "x")),
              HasSubstr("a name of 256 bytes; at most 255"));
  EXPECT_EQ(RefusalOfEntry(PaxHeader("path", std::string(255, 'n')) + TarEntry('0', "x")), "");
  std::string deep = "d";
  for (int i = 0; i < 64; ++i) deep += "/d";
  EXPECT_THAT(RefusalOfEntry(PaxHeader("path", deep) + TarEntry('0', "x")),
              HasSubstr("deeper than 64"));
  for (const char* outside : {"../x", "a/../../x", "..", "./../x"}) {
    EXPECT_THAT(RefusalOfEntry(PaxHeader("path", outside) + TarEntry('0', "x")),
                HasSubstr("\"..\" in its path"));
  }
  EXPECT_THAT(RefusalOfEntry(PaxHeader("path", "/etc/x") + TarEntry('0', "x")),
              HasSubstr("absolute path"));
  EXPECT_THAT(RefusalOfEntry(PaxHeader("linkpath", "../x") + TarEntry('2', "l", "", "x")),
              HasSubstr("targets with \"..\" are not allowed"));
  // A name ends at its NUL, so what follows has no effect.
  EXPECT_EQ(RefusalOfEntry(PaxHeader("path", std::string("ok\0/../../x", 11)) + TarEntry('0', "x")),
            "");
}

TEST(HostileArchives, EntriesThatContradictEachOther) {
  const std::string file = TarEntry('0', "n", "1");
  const std::string folder = TarEntry('5', "n/");
  const std::string link = TarEntry('2', "n", "", "/tmp");
  for (const std::string& first : {file, folder, link}) {
    for (const std::string& second : {file, folder, link}) {
      EXPECT_THAT(RefusalOfEntry(first + second), HasSubstr("\"n\" appears twice"));
    }
  }
  for (const std::string& first : {file, link}) {
    EXPECT_THAT(RefusalOfEntry(first + TarEntry('0', "n/below", "2")),
                HasSubstr("\"n/below\" is below \"n\", which is not a folder"));
  }
  EXPECT_THAT(RefusalOfEntry(TarEntry('0', "n/below", "2") + link), HasSubstr("appears twice"));
  // Two names on this file system, even if equal on others.
  EXPECT_EQ(RefusalOfEntry(TarEntry('0', "N", "1") + file), "");
}

TEST(HostileArchives, LinksAreKeptAndNeverFollowed) {
  const TestFolder temp;
  WriteBytes(temp / "a", Honest() + TarEntry('2', "python", "", "/usr/bin/python3") +
                             TarEntry('2', "self", "", "self") + TarEntry('2', "root", "", "/") +
                             End());
  EXPECT_EQ(Refusal(temp), "");
  EXPECT_EQ(fs::read_symlink(temp / "out/python"), "/usr/bin/python3");
  EXPECT_EQ(fs::read_symlink(temp / "out/root"), "/");
}

TEST(HostileArchives, ExtendedHeadersWithoutEnd) {
  std::string chain;
  for (int i = 0; i < 100'000; ++i) chain += PaxHeader("comment", "x");
  EXPECT_NE(RefusalOfPacked(Honest() + chain, Kind::kTarGz), "");
  EXPECT_NE(RefusalOfEntry(TarHeader('L', "long", "", 0644, 1 << 30)), "");
  EXPECT_NE(RefusalOfEntry(TarEntry('L', "long", std::string(4 << 20, 'n')) + TarEntry('0', "x")),
            "");
  // A malformed header has no effect: the entry keeps its plain name, which is checked.
  for (const char* nonsense : {"999999999 path=ok\n", "nonsense", "-5 path=ok\n", "10 path"}) {
    const std::string header = TarEntry('x', "pax", nonsense);
    EXPECT_NE(RefusalOfEntry(header + TarEntry('0', "../x")), "") << nonsense;
  }
}

TEST(HostileArchives, BrokenAndEmptyOnes) {
  std::string wrong_sum = TarEntry('0', "x", "1");
  wrong_sum[150] ^= 1;
  EXPECT_THAT(RefusalOfEntry(wrong_sum), HasSubstr("broken"));
  const std::string cut = Honest() + TarEntry('0', "x", std::string(4096, 'x'));
  for (const size_t missing : {1u, 512u, 4096u, 4608u - 511u}) {
    EXPECT_NE(RefusalOf(cut.substr(0, cut.size() - missing)), "") << missing;
  }
  EXPECT_NE(RefusalOf(End()), "");
  EXPECT_NE(RefusalOf(std::string("PK\5\6", 4) + std::string(18, '\0')), "");
  EXPECT_NE(RefusalOf(""), "");
  EXPECT_THAT(RefusalOf(TarEntry('0', "policy", "x", "", 0755) + End()),
              HasSubstr("no policy.json"));
}

TEST(HostileArchives, ZipsTooKeepTheRules) {
  EXPECT_THAT(RefusalOfWritten({{.path = "x", .content = "secret"}}, Kind::kEncryptedZip),
              HasSubstr("is encrypted; create the archive without a password"));
  EXPECT_THAT(RefusalOfWritten({{.path = "../x", .content = "x"}}, Kind::kZip),
              HasSubstr("\"..\""));
  EXPECT_THAT(RefusalOfWritten({{.path = "/x", .content = "x"}}, Kind::kZip),
              HasSubstr("absolute"));
  EXPECT_THAT(
      RefusalOfWritten({{.path = "l", .mode = AE_IFLNK | 0777, .link = "../x"}}, Kind::kZip),
      HasSubstr("targets with \"..\""));
  EXPECT_THAT(RefusalOfWritten({{.path = "su", .mode = AE_IFREG | 04755}}, Kind::kZip),
              HasSubstr("setuid"));
  EXPECT_THAT(RefusalOfWritten({{.path = "n"}, {.path = "n"}}, Kind::kZip), HasSubstr("twice"));
  // A zip in a zip is an ordinary file.
  const TestFolder temp;
  WriteArchive(temp / "inner", {{.path = "../x", .content = "x"}}, Kind::kZip);
  EXPECT_EQ(
      RefusalOfWritten({{.path = "in.zip", .content = ReadBytes(temp / "inner")}}, Kind::kZip), "");
}

TEST(HostileArchives, DamagedZipsAreRefusedOrHarmless) {
  const TestFolder temp;
  WriteArchive(temp / "good", {{.path = "policy.json", .content = kOwnManifest},
                               {.path = "policy", .content = "x", .mode = AE_IFREG | 0755}},
               Kind::kZip);
  const std::string good = ReadBytes(temp / "good");
  ASSERT_EQ(RefusalOf(good), "");
  for (size_t size = 0; size < good.size(); size += 3) RefusalOf(good.substr(0, size));
  for (size_t at = 0; at < good.size(); at += 2) {
    std::string changed = good;
    changed[at] = static_cast<char>(changed[at] ^ 0xff);
    RefusalOf(changed);
  }
}

}  // namespace
}  // namespace myograde::server

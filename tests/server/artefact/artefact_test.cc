// Packing and unpacking submissions: equal content gives equal digests, and every rule is enforced
// with a sentence that names the entry.
#include "server/artefact/artefact.h"

#include <archive_entry.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

Raw Manifest(const std::string& text = kManifest) {
  return {.path = "policy.json", .content = text};
}
Raw Program() { return {.path = "policy", .content = "#!/bin/sh\n", .mode = AE_IFREG | 0755}; }

absl::StatusOr<Artefact> Unpack(const std::vector<Raw>& entries, Kind kind = Kind::kTar,
                                const ArtefactLimits& limits = {}) {
  const TestFolder temp;
  WriteArchive(temp / "a", entries, kind);
  absl::StatusOr<Artefact> artefact = UnpackArtefact(temp / "a", temp / "out", limits);
  // A failure leaves nothing behind.
  EXPECT_EQ(fs::exists(temp / "out"), artefact.ok());
  return artefact;
}

// Unpacks a valid submission with `extra` in it; returns the error message, or "".
std::string Complaint(const std::vector<Raw>& extra, const ArtefactLimits& limits = {}) {
  std::vector<Raw> entries = {Manifest(), Program()};
  entries.insert(entries.end(), extra.begin(), extra.end());
  const absl::StatusOr<Artefact> artefact = Unpack(entries, Kind::kTar, limits);
  if (artefact.ok()) return "";
  EXPECT_EQ(artefact.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(artefact.status().message());
}

std::string ManifestComplaint(const std::string& manifest, const std::vector<Raw>& extra = {}) {
  std::vector<Raw> entries = {Manifest(manifest), Program()};
  entries.insert(entries.end(), extra.begin(), extra.end());
  const absl::StatusOr<Artefact> artefact = Unpack(entries);
  return artefact.ok() ? "" : std::string(artefact.status().message());
}

TEST(UnpackArtefact, EveryKindOfArchiveGivesTheSameDigest) {
  const std::vector<Raw> entries = {
      Manifest(), Program(), {.path = "data/weights", .content = "w"}};
  const auto tar = Unpack(entries);
  ASSERT_TRUE(tar.ok()) << tar.status();
  EXPECT_EQ(tar->manifest.name, "walker");
  EXPECT_EQ(tar->manifest.command, std::vector<std::string>{"./policy"});
  EXPECT_EQ(tar->files, 4);  // counts the folder
  EXPECT_EQ(tar->bytes, static_cast<int64_t>(sizeof kManifest - 1 + 10 + 1));
  for (const Kind kind :
       {Kind::kTarGz, Kind::kTarZst, Kind::kTarXz, Kind::kTarBz2, Kind::kZip}) {
    const auto other = Unpack(entries, kind);
    ASSERT_TRUE(other.ok()) << other.status();
    EXPECT_EQ(other->digest, tar->digest);
  }
}

TEST(UnpackArtefact, DigestLooksAtContentNotAtTheArchive) {
  const Raw folder = {.path = "data/", .mode = AE_IFDIR | 0700};
  const Raw file = {.path = "data/w", .content = "1"};
  const auto plain = Unpack({Manifest(), Program(), folder, file});
  ASSERT_TRUE(plain.ok()) << plain.status();
  const auto digest = [](const std::vector<Raw>& entries) {
    const auto artefact = Unpack(entries);
    return artefact.ok() ? artefact->digest : std::string(artefact.status().message());
  };
  EXPECT_EQ(digest({file, Program(), Manifest()}), plain->digest);            // different order, no
                                                                              // folder
  EXPECT_EQ(digest({{.path = "./", .mode = AE_IFDIR | 0755},
                    {.path = "./data//w", .content = "1", .mode = AE_IFREG | 0600},
                    Program(), Manifest()}), plain->digest);                  // different spelling
                                                                              // and modes
  EXPECT_NE(digest({Manifest(), Program(), {.path = "data/w", .content = "2"}}), plain->digest);
  EXPECT_NE(digest({Manifest(), Program(), {.path = "data/v", .content = "1"}}), plain->digest);
  EXPECT_NE(digest({Manifest(), Program(), {.path = "data/w", .content = "1",
                                            .mode = AE_IFREG | 0755}}), plain->digest);
  EXPECT_NE(digest({Manifest(), Program(), {.path = "data/w", .mode = AE_IFLNK | 0777,
                                            .link = "1"}}), plain->digest);
}

TEST(UnpackArtefact, KeepsLinksAsLinksAndFollowsNone) {
  const TestFolder temp;
  MakeFile(temp / "victim/secret", "untouched", 0644);
  WriteArchive(temp / "a",
               {Manifest(),
                Program(),
                {.path = "lib64", .mode = AE_IFLNK | 0777, .link = "lib"},
                {.path = "python3", .mode = AE_IFLNK | 0777, .link = "/usr/bin/python3"}});
  const auto artefact = UnpackArtefact(temp / "a", temp / "out", {});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  EXPECT_EQ(fs::read_symlink(temp / "out/lib64"), "lib");
  EXPECT_EQ(fs::read_symlink(temp / "out/python3"), "/usr/bin/python3");

  WriteArchive(temp / "b", {Manifest(), Program(),
                            {.path = "d", .mode = AE_IFLNK | 0777, .link = temp / "victim"},
                            {.path = "d/secret", .content = "overwritten"}});
  const auto through = UnpackArtefact(temp / "b", temp / "out2", {});
  EXPECT_THAT(through.status().message(), HasSubstr("\"d/secret\" is below \"d\""));
  std::string secret;
  std::ifstream(temp / "victim/secret") >> secret;
  EXPECT_EQ(secret, "untouched");
}

TEST(UnpackArtefact, RefusesWhatCouldReachOutside) {
  EXPECT_THAT(Complaint({{.path = "../evil"}}), HasSubstr("has \"..\" in its path"));
  EXPECT_THAT(Complaint({{.path = "a/../../evil"}}), HasSubstr("has \"..\" in its path"));
  EXPECT_THAT(Complaint({{.path = "/etc/evil"}}), HasSubstr("has an absolute path"));
  EXPECT_THAT(Complaint({{.path = "hard", .hard_link = "policy"}}), HasSubstr("is a hard link"));
  for (const char* target : {"..", "../x", "a/../../x", "/usr/../etc/shadow", "a/.."}) {
    EXPECT_THAT(Complaint({{.path = "l", .mode = AE_IFLNK | 0777, .link = target}}),
                HasSubstr("targets with \"..\" are not allowed"));
  }
  EXPECT_EQ(Complaint({{.path = "l", .mode = AE_IFLNK | 0777, .link = "..data/x.."}}), "");
}

TEST(UnpackArtefact, RefusesKindsAndBitsThatNoPolicyNeeds) {
  EXPECT_THAT(Complaint({{.path = "dev", .mode = AE_IFCHR | 0644}}), HasSubstr("a device node"));
  EXPECT_THAT(Complaint({{.path = "pipe", .mode = AE_IFIFO | 0644}}), HasSubstr("a named pipe"));
  EXPECT_THAT(Complaint({{.path = "su", .mode = AE_IFREG | 04755}}), HasSubstr("setuid or setgid"));
  EXPECT_THAT(Complaint({{.path = "sg", .mode = AE_IFREG | 02755}}), HasSubstr("setuid or setgid"));
  EXPECT_THAT(Complaint({{.path = "bell\a"}}), HasSubstr("control character"));
  EXPECT_THAT(Complaint({{.path = "policy", .content = "again"}}), HasSubstr("appears twice"));
  EXPECT_THAT(Complaint({{.path = "./policy", .content = "again"}}), HasSubstr("appears twice"));
  EXPECT_THAT(Complaint({{.path = "policy/below"}}), HasSubstr("which is not a folder"));
}

TEST(UnpackArtefact, CountsWhatItUnpacks) {
  // 8 MiB of zeros are a few kilobytes in the archive.
  const std::vector<Raw> bomb = {Manifest(), Program(),
                                 {.path = "bomb", .content = std::string(8 << 20, '\0')}};
  EXPECT_THAT(Unpack(bomb, Kind::kTarGz, {.bytes = 1 << 20}).status().message(),
              HasSubstr("larger than 1048576 bytes in total, unpacked (at \"bomb\")"));
  std::vector<Raw> many;
  for (int i = 0; i < 20; ++i) many.push_back({.path = "f" + std::to_string(i)});
  EXPECT_THAT(Complaint(many, {.files = 10}), HasSubstr("more than 10 files"));
  EXPECT_THAT(Complaint({{.path = "a/b/c/d"}}, {.depth = 3}), HasSubstr("deeper than 3"));
  EXPECT_EQ(Complaint({{.path = "a/b/c"}}, {.depth = 3}), "");
  EXPECT_THAT(Complaint({{.path = std::string(300, 'n')}}), HasSubstr("a name of 300 bytes"));
  EXPECT_FALSE(Unpack({Manifest(), Program()}, Kind::kTar, {.bytes = 0}).ok());
  EXPECT_FALSE(Unpack({Manifest(), Program()}, Kind::kTar, {.files = -1}).ok());
}

TEST(UnpackArtefact, RefusesWhatIsNoArchive) {
  const TestFolder temp;
  MakeFile(temp / "text", "just words", 0644);
  EXPECT_THAT(UnpackArtefact(temp / "text", temp / "out", {}).status().message(),
              HasSubstr("tar.gz, tar.zst, tar.xz, tar.bz2, zip"));
  MakeFile(temp / "empty", "", 0644);
  EXPECT_FALSE(UnpackArtefact(temp / "empty", temp / "out", {}).ok());
  EXPECT_FALSE(UnpackArtefact(temp / "missing", temp / "out", {}).ok());
  EXPECT_FALSE(fs::exists(temp / "out"));
}

TEST(UnpackArtefact, SurvivesEveryTruncationAndRandomDamage) {
  const TestFolder temp;
  WriteArchive(temp / "a",
               {Manifest(), Program(), {.path = "w", .content = std::string(5000, 'w')}},
               Kind::kTarGz);
  std::ifstream file(temp / "a", std::ios::binary);
  const std::string good((std::istreambuf_iterator<char>(file)), {});
  const auto unpacks = [&](const std::string& bytes) {
    MakeFile(temp / "damaged", bytes, 0644);
    const bool ok = UnpackArtefact(temp / "damaged", temp / "out", {}).ok();
    fs::remove_all(temp / "out");
    return ok;
  };
  ASSERT_TRUE(unpacks(good));
  for (size_t size = 0; size < good.size() / 2; ++size) EXPECT_FALSE(unpacks(good.substr(0, size)));
  EXPECT_TRUE(rc::check("damaged archives are refused or unpacked, never fatal", [&] {
    std::string bytes = good;
    bytes[*rc::gen::inRange<size_t>(0, bytes.size())] = *rc::gen::arbitrary<char>();
    unpacks(bytes);
  }));
}

TEST(ReadManifest, IsStrict) {
  EXPECT_EQ(
      ManifestComplaint(R"({"name": "a", "command": ["policy", "x"], "runtimes": ["python"]})"),
      "");
  const std::string start = R"({"name": "a", "command": ["./policy"], "extra_observations": )";
  EXPECT_EQ(ManifestComplaint(start + "true}"), "");
  EXPECT_EQ(ManifestComplaint(start + "false}"), "");
  EXPECT_THAT(ManifestComplaint(start + "1}"), HasSubstr("\"extra_observations\" must be"));
  const std::string agent = R"({"name": "a", "command": ["./policy"], "adapter": )";
  for (const char* right : {"2022", "2023", "2024"}) {
    EXPECT_EQ(ManifestComplaint(agent + "\"template-" + right + "\"}"), "");
  }
  for (const char* wrong : {"\"template-1999\"", "\"\"", "1", "[\"template-2024\"]", "null"}) {
    EXPECT_THAT(ManifestComplaint(agent + wrong + "}"), HasSubstr("\"adapter\"")) << wrong;
  }
  EXPECT_THAT(ManifestComplaint("{"), HasSubstr("policy.json: is not valid JSON"));
  EXPECT_THAT(ManifestComplaint("[]"), HasSubstr("must be an object"));
  EXPECT_THAT(ManifestComplaint(R"({"name": "a"})"), HasSubstr("\"command\" is missing"));
  EXPECT_THAT(ManifestComplaint(R"({"command": ["./policy"]})"), HasSubstr("\"name\" is missing"));
  EXPECT_THAT(ManifestComplaint(R"({"name": "", "command": ["./policy"]})"), HasSubstr("\"name\""));
  // Boards show the name: it must not hide text, reverse it or control a terminal.
  for (const char* name : {"a\\u001b[2J", "a\\u202eb", "a\\u009b2J", "\\u200b", "a\\u00adb"}) {
    EXPECT_THAT(
        ManifestComplaint(R"({"command": ["./policy"], "name": ")" + std::string(name) + "\"}"),
        HasSubstr("\"name\" has U+"))
        << name;
  }
  EXPECT_THAT(ManifestComplaint(R"({"name": " a", "command": ["./policy"]})"),
              HasSubstr("\"name\" must have 1 to 64 bytes"));
  EXPECT_EQ(ManifestComplaint(R"({"name": "Läufer 2 😀", "command": ["./policy"]})"), "");
  EXPECT_THAT(ManifestComplaint(R"({"name": "a", "command": []})"), HasSubstr("\"command\" must"));
  EXPECT_THAT(ManifestComplaint(R"({"name": "a", "command": "./policy"})"), HasSubstr("an array"));
  EXPECT_THAT(ManifestComplaint(R"({"name": "a", "command": ["./policy"], "gpu": true})"),
              HasSubstr("\"gpu\" is not a known key"));
  EXPECT_THAT(ManifestComplaint(R"({"name": "a", "command": ["./policy"], "runtimes": ["../x"]})"),
              HasSubstr("\"runtimes\" holds"));
}

TEST(ReadManifest, WantsAProgramThatCanBeRun) {
  const auto command = [](const std::string& program, const std::vector<Raw>& extra = {}) {
    return ManifestComplaint(R"({"name": "a", "command": [")" + program + R"("]})", extra);
  };
  const Raw link = {.path = "link", .mode = AE_IFLNK | 0777, .link = "policy"};
  EXPECT_EQ(command("/usr/bin/python3"), "");
  EXPECT_EQ(command("./link", {link}), "");
  EXPECT_EQ(command("venv/bin/python", {{.path = "venv/bin/python", .mode = AE_IFLNK | 0777,
                                         .link = "/usr/bin/python3"}}), "");
  EXPECT_THAT(command("./missing"), HasSubstr("does not exist"));
  EXPECT_EQ(command("policy"), "");   // a file of the submission
  EXPECT_EQ(command("python3"), "");  // or a program of the sandbox, which is checked elsewhere
  EXPECT_THAT(command("./policy.json"), HasSubstr("is not executable; set its bit"));
  EXPECT_THAT(command("./d", {{.path = "d/x"}}), HasSubstr("is a folder"));
  EXPECT_THAT(command("../policy"), HasSubstr("is not a file inside the submission"));
  EXPECT_THAT(command("a", {{.path = "a", .mode = AE_IFLNK | 0777, .link = "b"},
                            {.path = "b", .mode = AE_IFLNK | 0777, .link = "a"}}),
              HasSubstr("loop"));
}

TEST(UnpackArtefact, WithoutAnyModeProgramsAreExecutable) {
  const auto with_modes = Unpack({Manifest(), Program(), {.path = "data", .content = "d"}});
  ASSERT_TRUE(with_modes.ok()) << with_modes.status();
  for (const Kind kind : {Kind::kTar, Kind::kZip}) {
    const auto without = Unpack({Manifest(), {.path = "policy", .content = "#!/bin/sh\n"},
                                 {.path = "data", .content = "d"}}, kind);
    ASSERT_TRUE(without.ok()) << without.status();
    EXPECT_EQ(without->digest, with_modes->digest);
  }
  // The tar of Windows makes .bat executable, whatever else there is.
  const Raw batch = {.path = "train.bat", .content = "python train.py\r\n", .mode = AE_IFREG | 0777};
  const auto windows = Unpack({Manifest(), {.path = "policy", .content = "#!/bin/sh\n"}, batch});
  ASSERT_TRUE(windows.ok()) << windows.status();
  EXPECT_EQ(windows->digest, Unpack({Manifest(), Program(), batch})->digest);
  // Where any program has one, all are meant.
  const auto mixed = Unpack({Manifest(), {.path = "policy", .content = "#!/bin/sh\n"},
                             {.path = "tool", .content = "#!/bin/sh\n", .mode = AE_IFREG | 0755}});
  EXPECT_THAT(std::string(mixed.status().message()), HasSubstr("chmod +x"));
  // Where nothing needs one, the artefact stays what it was.
  const std::string python = R"({"name": "p", "command": ["python3", "policy"]})";
  const auto script = Unpack({Manifest(python), {.path = "policy", .content = "#!/bin/sh\n"}});
  const auto program = Unpack({Manifest(python), Program()});
  ASSERT_TRUE(script.ok() && program.ok());
  EXPECT_NE(script->digest, program->digest);
  // On the way of the command line.
  const TestFolder temp;
  WriteArchive(temp / "a.zip", {Manifest(), {.path = "policy", .content = "#!/bin/sh\n"}}, Kind::kZip);
  const auto packed = PackArtefact(temp / "a.zip", temp / "packed", {});
  EXPECT_TRUE(packed.ok()) << packed.status();
}

TEST(ReadManifest, WhatWindowsWritesIsExplained) {
  std::string wide = "\xff\xfe";
  for (const char c : std::string(kManifest)) wide += {c, '\0'};
  EXPECT_THAT(ManifestComplaint(wide), HasSubstr("save it as UTF-8"));
  EXPECT_THAT(ManifestComplaint(wide.substr(2)), HasSubstr("save it as UTF-8"));
  EXPECT_EQ(ManifestComplaint("\xef\xbb\xbf" + std::string(kManifest)), "");
  EXPECT_THAT(ManifestComplaint(R"({"name": "n", "command": ["./run"]})",
                                {{.path = "run", .content = "#!/bin/sh\r\nexec ./policy\r\n",
                                  .mode = AE_IFREG | 0755}}),
              HasSubstr("line ends of Windows"));
}

TEST(UnpackArtefact, APointerOfGitLfsIsNoContent) {
  EXPECT_THAT(Complaint({{.path = "weights.pt", .content = "version https://git-lfs.github.com/spec/v1\n"
                                                           "oid sha256:12\nsize 4\n"}}),
              HasSubstr("git lfs pull"));
}

TEST(ReadManifest, ABareWordIsAFileOfTheSubmissionOrAProgramOnThePath) {
  const auto program = [](const std::string& word, const std::vector<Raw>& extra) {
    std::vector<Raw> entries = {Manifest(R"({"name": "a", "command": [")" + word + R"("]})"),
                                Program()};
    entries.insert(entries.end(), extra.begin(), extra.end());
    const auto artefact = Unpack(entries);
    return artefact.ok() ? artefact->manifest.command[0] : std::string(artefact.status().message());
  };
  EXPECT_EQ(program("policy", {}), "./policy");
  EXPECT_EQ(program("./policy", {}), "./policy");
  EXPECT_EQ(program("python3", {}), "python3");
  // A folder can't be what is meant.
  EXPECT_EQ(program("python3", {{.path = "python3/x"}}), "python3");
  EXPECT_EQ(program("python3", {{.path = "python3", .mode = AE_IFLNK | 0777,
                                 .link = "/usr/bin/python3"}}), "./python3");
  EXPECT_THAT(program("python3", {{.path = "python3", .content = "data"}}),
              HasSubstr("is not executable"));
}

TEST(ReadManifest, SetsVariablesOfThePolicysOwn) {
  const auto environment = [](const std::string& env) {
    return ManifestComplaint(R"({"name": "a", "command": ["./policy"], "env": )" + env + "}");
  };
  const auto artefact = Unpack({Manifest(R"({"name": "a", "command": ["./policy"],
                    "env": {"OMP_NUM_THREADS": "2", "POLICY_MODE": "", "LD_LIBRARY_PATH": "lib"}})"),
                                Program()});
  ASSERT_TRUE(artefact.ok()) << artefact.status();
  EXPECT_EQ(artefact->manifest.environment,
            (std::map<std::string, std::string>{
                {"LD_LIBRARY_PATH", "lib"}, {"OMP_NUM_THREADS", "2"}, {"POLICY_MODE", ""}}));
  EXPECT_EQ(environment("{}"), "");
  for (const char* name : {"PATH", "HOME", "MYOGRADE_LCM_URL", "GLIBC_TUNABLES", "LD_PRELOAD", "",
                           "policy_mode", "POLICY_A=B", "POLICY_\\u0001"}) {
    EXPECT_THAT(environment("{\"" + std::string(name) + "\": \"x\"}"),
                HasSubstr("which is not allowed; it may set")) << name;
  }
  EXPECT_THAT(environment(R"({"POLICY_A": 1})"), HasSubstr("must be a string"));
  EXPECT_THAT(environment(R"(["POLICY_A"])"), HasSubstr("must be an object"));
  EXPECT_THAT(environment(R"({"POLICY_A": "x\u0000y"})"), HasSubstr("zero byte"));
  EXPECT_THAT(environment("{\"POLICY_A\": \"" + std::string(4097, 'x') + "\"}"),
              HasSubstr("more than 4096 bytes"));
  std::string many = "{";
  for (int i = 0; i < 65; ++i) {
    many += (i > 0 ? ", " : "") + ("\"POLICY_" + std::to_string(i)) + "\": \"\"";
  }
  EXPECT_THAT(environment(many + "}"), HasSubstr("at most 64 variables"));
}

TEST(ReadManifest, SaysWhereTheManifestIsWhenTheFolderWasPacked) {
  const auto nested = Unpack({{.path = "mine/policy.json", .content = kManifest},
                              {.path = "mine/policy", .mode = AE_IFREG | 0755}});
  EXPECT_THAT(nested.status().message(), HasSubstr("it is at \"mine/policy.json\""));
  EXPECT_THAT(Unpack({Program()}).status().message(), HasSubstr("no policy.json"));
  EXPECT_THAT(Unpack({Program(), {.path = "policy.json", .mode = AE_IFLNK | 0777,
                                  .link = "/etc/passwd"}}).status().message(),
              HasSubstr("not a link"));
}

TEST(PackArtefact, FolderArchiveAndProgramComeBackTheSame) {
  const TestFolder temp;
  MakeFile(temp / "p/policy.json", kManifest, 0600);
  MakeFile(temp / "p/policy", "#!/bin/sh\n", 0700);
  MakeFile(temp / "p/\xc3\xbc/" + std::string(150, 'x') + "/w", std::string(200'000, 'w'), 0644);
  fs::create_symlink("/usr/bin/python3", temp / "p/python3");
  const auto packed = PackArtefact(temp / "p", temp / "a.tar", {});
  ASSERT_TRUE(packed.ok()) << packed.status();
  EXPECT_EQ(packed->command, std::vector<std::string>{"./policy"});
  const auto first = UnpackArtefact(temp / "a.tar", temp / "out", {});
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_TRUE(fs::exists(temp / "out/\xc3\xbc/" + std::string(150, 'x') + "/w"));
  EXPECT_EQ(fs::status(temp / "out/policy").permissions(), fs::perms(0755));
  EXPECT_EQ(fs::status(temp / "out/policy.json").permissions(), fs::perms(0644));

  // Packed again, from the archive and from the unpacked folder: the same bytes.
  ASSERT_TRUE(PackArtefact(temp / "a.tar", temp / "b", {}).ok());
  ASSERT_TRUE(PackArtefact(temp / "out", temp / "c", {}).ok());
  const auto bytes = [](const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return std::string((std::istreambuf_iterator<char>(file)), {});
  };
  EXPECT_EQ(bytes(temp / "a.tar"), bytes(temp / "b"));
  EXPECT_EQ(bytes(temp / "a.tar"), bytes(temp / "c"));
  EXPECT_FALSE(fs::exists(temp / "b.unpacked"));

  const auto program = PackArtefact(temp / "p/policy", temp / "d", {});
  ASSERT_TRUE(program.ok()) << program.status();
  const auto single = UnpackArtefact(temp / "d", temp / "out2", {});
  ASSERT_TRUE(single.ok()) << single.status();
  EXPECT_EQ(single->manifest.name, "policy");
  EXPECT_EQ(single->manifest.command, std::vector<std::string>{"./policy"});
}

// Python uses a compiled module only if its source still has the time that the module records.
TEST(PackArtefact, FilesKeepTheirTimesAndTheDigestIsOfNone) {
  const TestFolder temp;
  MakeFile(temp / "p/policy.json", kManifest, 0644);
  MakeFile(temp / "p/policy", "#!/bin/sh\n", 0755);
  MakeFile(temp / "p/module.py", "pass\n", 0644);
  const auto time_of = [](const std::string& path) {
    struct stat info = {};
    EXPECT_EQ(::stat(path.c_str(), &info), 0);
    return std::pair(info.st_mtim.tv_sec, info.st_mtim.tv_nsec);
  };
  std::string digest;
  for (const time_t seconds : {time_t{1718000001}, time_t{1600000000}}) {
    const timespec times[] = {{seconds, 5}, {seconds, 999}};
    ASSERT_EQ(::utimensat(AT_FDCWD, (temp / "p/module.py").c_str(), times, 0), 0);
    ASSERT_TRUE(PackArtefact(temp / "p", temp / "a.tar", {}).ok());
    ASSERT_TRUE(PackArtefact(temp / "a.tar", temp / "b.tar", {}).ok());
    for (const char* archive : {"a.tar", "b.tar"}) {
      const auto artefact = UnpackArtefact(temp / archive, temp / "out", {});
      ASSERT_TRUE(artefact.ok()) << artefact.status();
      EXPECT_EQ(time_of(temp / "out/module.py"), std::pair(seconds, 0L)) << archive;
      if (digest.empty()) digest = artefact->digest;
      EXPECT_EQ(artefact->digest, digest);
      fs::remove_all(temp / "out");
    }
  }
}

}  // namespace
}  // namespace myograde::server

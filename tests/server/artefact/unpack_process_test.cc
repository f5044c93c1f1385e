// Unpacking in a separate process: the same results, and bounds for slow and hungry archives.
#include "server/artefact/unpack_process.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "server/artefact/listing.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Where myograde-unpack is.
[[maybe_unused]] const int kBinDirSet = ::setenv("MYOGRADE_BIN_DIR", MYOGRADE_BIN_DIR, 1);

const UnpackBudget kBudget = {.time = absl::Seconds(60), .memory_bytes = 256 << 20};

std::string HonestArchive() {
  return TarEntry('0', "policy.json",
                  R"({"name": "ü", "command": ["./policy", "a b"], "env": {"POLICY_A": "ü"},
                      "extra_observations": true, "adapter": "template-2024"})") +
         TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755);
}

TEST(UnpackProcess, AnswersAsUnpackArtefactDoes) {
  const TestFolder temp;
  WritePacked(temp / "a", HonestArchive() + std::string(1024, '\0'), Kind::kTarGz);
  const auto apart = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  ASSERT_TRUE(apart.ok()) << apart.status();
  const auto here = UnpackArtefact(temp / "a", temp / "out2", {});
  ASSERT_TRUE(here.ok()) << here.status();
  EXPECT_EQ(apart->digest, here->digest);
  EXPECT_EQ(apart->manifest.name, here->manifest.name);
  EXPECT_EQ(apart->manifest.command, here->manifest.command);
  EXPECT_EQ(apart->manifest.environment, here->manifest.environment);
  EXPECT_TRUE(apart->manifest.extra_observations && here->manifest.extra_observations);
  EXPECT_EQ(apart->manifest.adapter, "template-2024");
  EXPECT_EQ(here->manifest.adapter, "template-2024");
  // The adapter brings the runtime that it needs.
  EXPECT_EQ(apart->manifest.runtimes, std::vector<std::string>{"template-2024"});
  EXPECT_EQ(apart->bytes, here->bytes);
  EXPECT_EQ(apart->files, here->files);
  EXPECT_TRUE(fs::exists(temp / "out/policy"));
}

TEST(UnpackProcess, EveryKindOfArchiveIsUnpackedBehindTheFilter) {
  const std::vector<Raw> entries = {
      {"policy.json", R"({"name": "é", "command": ["./run"]})"},
      {"run", "#!/bin/sh\n", AE_IFREG | 0755},
      {"dé/" + std::string(120, 'n') + "/big", std::string(3 << 20, 'x')},
      {"l", {}, AE_IFLNK | 0777, "/usr/bin/python3"}};
  const Utf8Names utf8_names;
  for (const Kind kind : {Kind::kTar, Kind::kTarGz, Kind::kTarZst, Kind::kZip}) {
    const TestFolder temp;
    WriteArchive(temp / "a", entries, kind);
    const auto apart = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
    ASSERT_TRUE(apart.ok()) << apart.status() << " of kind " << static_cast<int>(kind);
    EXPECT_EQ(apart->digest, UnpackArtefact(temp / "a", temp / "out2", {})->digest);
    EXPECT_EQ(fs::read_symlink(temp / "out/l"), "/usr/bin/python3");
  }
}

// The wait status of a child that confined itself to `folder` and then ran `deed`.
int StatusOf(const std::string& folder, const std::function<bool()>& deed) {
  const pid_t child = ::fork();
  if (child == 0) {
    const Fd opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!ConfineUnpacking(opened.get()).ok()) ::_exit(3);
    ::_exit(deed() ? 0 : 1);
  }
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return status;
}

TEST(ConfineUnpacking, EndsTheProcessAtAForbiddenCall) {
  const TestFolder temp;
  const pid_t self = ::getpid();
  const std::string old = temp / "old";
  std::ofstream(old) << "x";
  const std::pair<const char*, std::function<bool()>> deeds[] = {
      {"execve", [] { return ::execl("/run", "run", nullptr) == 0; }},
      {"fork", [] { return ::syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0) >= 0; }},
      {"socket", [] { return ::socket(AF_UNIX, SOCK_STREAM, 0) >= 0; }},
      {"ptrace", [self] { return ::syscall(SYS_ptrace, 16, self, 0, 0) == 0; }},
      {"kill", [self] { return ::kill(self, 0) == 0; }},
      {"setuid", [] { return ::syscall(SYS_setuid, 0) == 0; }},
      {"chroot", [] { return ::chroot("/") == 0; }},
      {"unshare", [] { return ::unshare(CLONE_NEWUSER) == 0; }},
      {"mknod", [] { return ::mknod("/null", S_IFCHR | 0666, makedev(1, 3)) == 0; }},
      {"link", [] { return ::link("/old", "/new") == 0; }},
      {"unlink", [] { return ::unlink("/old") == 0; }},
      {"chown", [] { return ::chown("/old", 1, 1) == 0; }},
      {"int 0x80", [] {
         long result = 20;  // getpid for 32-bit programs
         asm volatile("int $0x80" : "+a"(result) : : "memory");
         return result > 0;
       }},
      {"memory to run", [] {
         return ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE | PROT_EXEC,
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED;
       }}};
  for (const auto& [name, deed] : deeds) {
    const int status = StatusOf(temp.path().string(), deed);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS) << name << ": " << status;
  }
  EXPECT_TRUE(fs::exists(old));
}

TEST(ConfineUnpacking, LeavesNoFileButThoseOfItsFolder) {
  const TestFolder temp;
  std::ofstream(temp / "mine") << "x";
  const auto opens = [](const char* path, int flags) {
    return [path, flags] { return ::openat(AT_FDCWD, path, flags | O_CLOEXEC, 0600) >= 0; };
  };
  const std::string folder = temp.path().string();
  EXPECT_EQ(StatusOf(folder, opens("/mine", O_RDWR)), 0);
  EXPECT_EQ(StatusOf(folder, opens("/new", O_WRONLY | O_CREAT | O_EXCL)), 0);
  for (const char* path :
       {"/etc/passwd", "../../../../etc/passwd", "/proc/self/exe", "/dev/null"}) {
    const int status = StatusOf(folder, opens(path, O_RDONLY));
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 1) << path << ": " << status;
  }
}

TEST(UnpackProcess, RefusalsArriveWithTheirSentence) {
  const TestFolder temp;
  WritePacked(temp / "a", HonestArchive() + TarEntry('0', "../evil", "x"), Kind::kTarGz);
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status()));
  EXPECT_THAT(artefact.status().message(), HasSubstr("\"..\" in its path"));
  EXPECT_FALSE(fs::exists(temp / "out"));
  const auto small = UnpackInProcess(temp / "a", temp / "out", {.files = 1}, kBudget);
  EXPECT_THAT(small.status().message(), HasSubstr("more than 1 files"));
  const auto missing = UnpackInProcess(temp / "missing", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsUnavailable(missing.status())) << missing.status();
}

TEST(UnpackProcess, EndsAtItsDeadline) {
  const TestFolder temp;
  // A FIFO without a writer: the slowest possible archive.
  ASSERT_EQ(::mkfifo((temp / "a").c_str(), 0600), 0);
  const absl::Duration start = SystemClock().Monotonic();
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {},
                                        {.time = absl::Seconds(1), .memory_bytes = 256 << 20});
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(20));
  // The wall clock says nothing about the archive.
  EXPECT_TRUE(absl::IsDeadlineExceeded(artefact.status())) << artefact.status();
  EXPECT_THAT(artefact.status().message(), HasSubstr("could not be unpacked within 1s"));
  EXPECT_FALSE(fs::exists(temp / "out"));
}

// The children of this process, as the kernel lists them.
std::vector<pid_t> Children() {
  std::vector<pid_t> children;
  for (const fs::directory_entry& task : fs::directory_iterator("/proc/self/task")) {
    std::ifstream file(task.path() / "children");
    for (pid_t pid; file >> pid;) children.push_back(pid);
  }
  return children;
}

TEST(UnpackProcess, AnEndFromOutsideIsNotTheArchivesFault) {
  for (const int signal : {SIGKILL, SIGTERM, SIGHUP}) {
    const TestFolder temp;
    ASSERT_EQ(::mkfifo((temp / "a").c_str(), 0600), 0);
    UnpackBudget budget = kBudget;
    int asked = 0;
    budget.go_on = [&] {
      if (++asked == 3) {
        for (const pid_t child : Children()) ::kill(child, signal);
      }
      return absl::OkStatus();
    };
    const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, budget);
    EXPECT_TRUE(absl::IsUnavailable(artefact.status())) << signal << ": " << artefact.status();
    EXPECT_THAT(artefact.status().message(), HasSubstr("from outside"));
    EXPECT_FALSE(fs::exists(temp / "out"));
  }
}

TEST(UnpackProcess, ACrashIsTheArchivesFault) {
  const TestFolder temp;
  ASSERT_EQ(::mkfifo((temp / "a").c_str(), 0600), 0);
  UnpackBudget budget = kBudget;
  int asked = 0;
  budget.go_on = [&] {
    if (++asked == 3) {
      for (const pid_t child : Children()) ::kill(child, SIGSYS);
    }
    return absl::OkStatus();
  };
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, budget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
}

TEST(UnpackProcess, IsEndedOnRequest) {
  const TestFolder temp;
  ASSERT_EQ(::mkfifo((temp / "a").c_str(), 0600), 0);
  UnpackBudget budget = kBudget;
  int asked = 0;
  budget.go_on = [&] {
    return ++asked < 3 ? absl::OkStatus() : absl::CancelledError("enough");
  };
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, budget);
  EXPECT_EQ(artefact.status(), absl::CancelledError("enough"));
  EXPECT_FALSE(fs::exists(temp / "out"));
}

TEST(UnpackProcess, ProcessorTimeIsLimited) {
  const TestFolder temp;
  constexpr size_t kBytes = size_t{6} << 30;
  {
    const std::unique_ptr<archive, int (*)(archive*)> writer(archive_write_new(),
                                                             archive_write_free);
    archive_write_add_filter_zstd(writer.get());
    archive_write_set_format_pax(writer.get());
    ASSERT_EQ(archive_write_open_filename(writer.get(), (temp / "a").c_str()), ARCHIVE_OK);
    const std::unique_ptr<archive_entry, void (*)(archive_entry*)> entry(archive_entry_new(),
                                                                         archive_entry_free);
    archive_entry_set_pathname(entry.get(), "zeros");
    archive_entry_set_filetype(entry.get(), AE_IFREG);
    archive_entry_set_perm(entry.get(), 0644);
    archive_entry_set_size(entry.get(), static_cast<int64_t>(kBytes));
    ASSERT_EQ(archive_write_header(writer.get(), entry.get()), ARCHIVE_OK);
    const std::string zeros(size_t{4} << 20, '\0');
    for (size_t done = 0; done < kBytes; done += zeros.size()) {
      archive_write_data(writer.get(), zeros.data(), zeros.size());
    }
  }
  UnpackBudget budget = kBudget;
  budget.cpu = absl::Seconds(1);
  const auto artefact =
      UnpackInProcess(temp / "a", temp / "out", {.bytes = int64_t{8} << 30}, budget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
  EXPECT_THAT(artefact.status().message(), HasSubstr("processor time"));
  EXPECT_FALSE(fs::exists(temp / "out"));
}

TEST(UnpackOpened, AFileThatTheHostCantReadIsNotTheArchivesFault) {
  const TestFolder temp;
  const Fd broken(::open("/proc/self/mem", O_RDONLY | O_CLOEXEC));  // fails with EIO at the start
  const Fd folder(::open(temp.path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  const auto artefact = UnpackOpened(broken.get(), folder.get(), {});
  EXPECT_FALSE(artefact.ok());
  EXPECT_FALSE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
}

TEST(UnpackProcess, MemoryIsLimited) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "a sanitizer's shadow takes more addresses than any limit of memory";
#endif
  // The map of a sparse file: 48 bytes of memory for every 4 bytes, which compress to nothing.
  std::string map = "20000000\n";
  for (int i = 0; i < 20'000'000; ++i) map += "0\n0\n";
  std::string tar = HonestArchive() + PaxHeader("GNU.sparse.major", "1") +
                    PaxHeader("GNU.sparse.minor", "0") + PaxHeader("GNU.sparse.realsize", "1000") +
                    TarHeader('0', "holes", "", 0644, map.size());
  tar += map + TarPadding(map.size());
  const TestFolder temp;
  WritePacked(temp / "a", tar, Kind::kTarZst);
  ASSERT_LT(fs::file_size(temp / "a"), 1u << 20);
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
  EXPECT_FALSE(fs::exists(temp / "out"));
}

}  // namespace
}  // namespace myograde::server

// Finds processes of real sandboxes from outside: by marks as an ordinary user, by users as root.
#include "server/sandbox/slot_processes.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <fcntl.h>
#include <grp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

#include "protocol/base/clock.h"
#include "server/sandbox/policy_sandbox.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

using Kind = SandboxMount::Kind;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::Pair;

constexpr absl::Duration kLong = absl::Seconds(60);
constexpr uid_t kOrdinary = 71998;

std::unique_ptr<Sandbox> StartMarked(const std::string& mark, const std::string& script, int out) {
  SandboxSpec spec;
  for (const std::string& link : SystemLinks()) {
    spec.mounts.push_back({Kind::kSymlink, "usr/" + link, "/" + link});
  }
  for (const std::string& path : SystemPlaces()) {
    spec.mounts.push_back({Kind::kReadOnly, path, path});
  }
  spec.mounts.push_back({Kind::kProc, "", "/proc"});
  spec.mounts.push_back({Kind::kDev, "", "/dev"});
  spec.mounts.push_back({Kind::kTmpfs, "", "/tmp"});
  if (!mark.empty()) spec.mounts.push_back({Kind::kReadOnly, mark, "/myograde/slot"});
  spec.mounts.push_back({Kind::kSealed, "", "/"});
  spec.environment = {{"PATH", "/usr/bin:/bin:/usr/sbin:/sbin"}};
  spec.command = {"/bin/sh", "-c", script};
  spec.working_dir = "/tmp";
  const auto config = LoadSandboxConfig(std::string(MYOGRADE_SOURCE_DIR) + "/configs");
  const auto filter = MakeSeccompFilter(config.value().policy);
  auto sandbox = Sandbox::Start(spec, {{out, 1}, {STDERR_FILENO, 2}}, {}, filter.value());
  return sandbox.ok() ? *std::move(sandbox) : nullptr;
}

// A sandbox whose script has printed a line.
class Marked {
 public:
  Marked(const std::string& mark, const std::string& script) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) return;
    const Fd out(ends[0]);
    Fd in(ends[1]);
    sandbox_ = StartMarked(mark, script, in.get());
    in.reset();
    for (char c = 0; read(out.get(), &c, 1) == 1 && c != '\n';) said_ += c;
  }
  bool Kill() { return sandbox_ != nullptr && sandbox_->Kill(kLong); }
  const std::string& said() const { return said_; }

 private:
  std::unique_ptr<Sandbox> sandbox_;
  std::string said_;
};

class SlotProcessesTest : public ::testing::Test {
 protected:
  // Runs `work`, which may use EXPECT, in a child that is an ordinary user if this process is not.
  static void AsOrdinaryUser(const std::function<void(const std::string& folder)>& work) {
    std::fflush(nullptr);
    const pid_t child = fork();
    if (child == 0) {
      if (geteuid() == 0 &&
          (setgroups(0, nullptr) != 0 || setresgid(kOrdinary, kOrdinary, kOrdinary) != 0 ||
           setresuid(kOrdinary, kOrdinary, kOrdinary) != 0)) {
        _exit(2);
      }
      if (!CanMakeUserNamespace()) _exit(77);
      // Characters that mountinfo escapes.
      std::string folder = (fs::temp_directory_path() / "myograde slots\\\t-XXXXXX").string();
      if (mkdtemp(folder.data()) == nullptr) _exit(3);
      work(folder);
      fs::remove_all(folder);
      std::fflush(nullptr);
      _exit(HasFailure() ? 1 : 0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 77) GTEST_SKIP() << "no user namespaces here";
    EXPECT_EQ(status, 0);
  }

  // What is found once each of it sleeps: a program that has just printed its line, or is about to
  // start `sleep`, is on its way to that state on a busy host. Nothing is waited for where
  // nothing is found.
  static std::map<int, std::string> FindAsleep(const SlotProcesses& slots, int first,
                                               int count) {
    const Deadline deadline(kLong);
    for (;;) {
      std::map<int, std::string> found = slots.Find(first, count);
      const bool asleep = std::ranges::all_of(found, [](const auto& slot) {
        return slot.second.find("(sleep, state S)") != std::string::npos ||
               slot.second.find("(python3, state S)") != std::string::npos;
      });
      if (asleep || deadline.over()) return found;
      usleep(10000);
    }
  }

  static std::string MarkOf(const SlotProcesses& slots, int64_t slot) {
    LeaseOrder order;
    order.slot = slot;
    EXPECT_TRUE(slots.Claim(order).ok());
    EXPECT_EQ(order.uid, -1);
    return order.slot_mark;
  }
};

TEST_F(SlotProcessesTest, AnOrderIsClaimedByItsSlotsUserOrByItsMark) {
  LeaseOrder order;
  order.slot = 3;
  ASSERT_TRUE(SlotProcesses(5000, "/nowhere/slots").Claim(order).ok());
  EXPECT_EQ(order.uid, 5003);
  EXPECT_EQ(order.slot_mark, "");
  EXPECT_FALSE(SlotProcesses(-1, "/proc/slots").Claim(order).ok());
}

TEST_F(SlotProcessesTest, ASlotsMarkIsFoundAndNothingElse) {
  AsOrdinaryUser([](const std::string& folder) {
    const SlotProcesses slots(-1, folder + "/slots");
    EXPECT_THAT(slots.Find(0, 4), IsEmpty()) << "there is not even a folder";
    const SlotProcesses other(-1, folder + "/other/slots");
    const std::string script = "echo ready; exec sleep 1000";
    Marked third(MarkOf(slots, 2), script);
    Marked others(MarkOf(other, 1), script);
    Marked nobodys("", script);
    ASSERT_EQ(third.said() + others.said() + nobodys.said(), "readyreadyready");
    EXPECT_THAT(FindAsleep(slots, 0, 4), ElementsAre(Pair(2, HasSubstr("(sleep, state S)"))));
    EXPECT_THAT(FindAsleep(slots, 2, 1), ElementsAre(Pair(2, HasSubstr("(sleep, state S)"))));
    EXPECT_THAT(slots.Find(0, 2), IsEmpty());
    EXPECT_THAT(FindAsleep(other, 0, 4), ElementsAre(Pair(1, HasSubstr("(sleep, state S)"))));
    EXPECT_TRUE(third.Kill());
    EXPECT_THAT(slots.Find(0, 4), IsEmpty());
    EXPECT_THAT(FindAsleep(other, 0, 4), ElementsAre(Pair(1, HasSubstr("sleep"))));
  });
}

TEST_F(SlotProcessesTest, AMarkCantBeShed) {
  AsOrdinaryUser([](const std::string& folder) {
    const SlotProcesses slots(-1, folder + "/slots");
    Marked policy(MarkOf(slots, 0),
                  "shed=0; exec 2>/dev/null\n"
                  "for try in 'umount /myograde/slot' 'umount -l /myograde/slot' "
                  "  'umount -l /' 'mount -t tmpfs none /myograde/slot' 'mount --move / /tmp' "
                  "  'mount --bind /tmp /' 'unshare -rm true' 'unshare -m true' 'unshare -U true' "
                  "  'chroot /tmp /usr/bin/true' 'chroot / true' 'nsenter -t 1 -m true' "
                  "  'pivot_root /tmp /tmp' 'rmdir /myograde/slot' 'mv /myograde /tmp'; do\n"
                  "  $try && shed=$((shed + 1))\n"
                  "done\n"
                  "(exec 0<&- 1>&- 2>&-; ulimit -n 3; exec env -i setsid -f sleep 1000)\n"
                  "echo $shed; exec python3 -c 'import time; time.sleep(1000)'");
    EXPECT_EQ(policy.said(), "0");
    const Deadline deadline(kLong);
    while (slots.Find(0, 1)[0].find("(sleep, state S)") == std::string::npos && !deadline.over()) {
      usleep(10000);
    }
    EXPECT_THAT(slots.Find(0, 1), ElementsAre(Pair(0, HasSubstr("(sleep, state S)"))));
  });
}

TEST_F(SlotProcessesTest, AProcessThatCantBeLookedIntoIsFound) {
  AsOrdinaryUser([](const std::string& folder) {
    const SlotProcesses slots(-1, folder + "/slots");
    Marked policy(MarkOf(slots, 0),
                  "exec python3 -c 'import ctypes, time\n"
                  "print(ctypes.CDLL(None).prctl(4, 0, 0, 0, 0), flush=True)\n"
                  "time.sleep(1000)'");
    EXPECT_EQ(policy.said(), "0");
    EXPECT_THAT(slots.Find(0, 1), ElementsAre(Pair(0, HasSubstr("(python3"))));
  });
}

TEST_F(SlotProcessesTest, AProcessIsFoundWhoseFirstThreadHasEnded) {
  AsOrdinaryUser([](const std::string& folder) {
    const SlotProcesses slots(-1, folder + "/slots");
    Marked policy(MarkOf(slots, 0),
                  "exec python3 -c 'import ctypes, threading, time\n"
                  "def stay():\n"
                  "  time.sleep(0.2)\n"
                  "  print(open(\"/proc/self/stat\").read().split()[2], flush=True)\n"
                  "  time.sleep(1000)\n"
                  "threading.Thread(target=stay).start()\n"
                  "ctypes.CDLL(None).syscall(60, 0)'");
    EXPECT_EQ(policy.said(), "Z");
    EXPECT_THAT(FindAsleep(slots, 0, 1), ElementsAre(Pair(0, HasSubstr("(python3, state S)"))));
    EXPECT_TRUE(policy.Kill());
    EXPECT_THAT(slots.Find(0, 1), IsEmpty());
  });
}

TEST_F(SlotProcessesTest, AMarkStaysOneWhenItsFolderIsMovedOrRemoved) {
  AsOrdinaryUser([](const std::string& folder) {
    const SlotProcesses slots(-1, folder + "/slots");
    const SlotProcesses moved(-1, folder + "/moved");
    const std::string mark = MarkOf(slots, 1);
    Marked policy(mark, "echo ready; exec sleep 1000");
    fs::rename(folder + "/slots", folder + "/moved");
    EXPECT_THAT(slots.Find(0, 2), IsEmpty());
    EXPECT_THAT(FindAsleep(moved, 0, 2), ElementsAre(Pair(1, HasSubstr("sleep"))));
    fs::rename(folder + "/moved", folder + "/slots");
    fs::remove(mark);
    EXPECT_THAT(FindAsleep(slots, 0, 2), ElementsAre(Pair(1, HasSubstr("sleep"))));
    EXPECT_EQ(MarkOf(slots, 1), mark) << "made anew";
    EXPECT_THAT(FindAsleep(slots, 0, 2), ElementsAre(Pair(1, HasSubstr("sleep"))));
  });
}

TEST_F(SlotProcessesTest, ASlotsUsersAreFoundAndWhoIsDeadIsNot) {
  if (geteuid() != 0) GTEST_SKIP() << "only root has users for its slots";
  const SlotProcesses slots(kOrdinary - 2, "/nowhere/slots");
  for (const uid_t simulators : {0u, 4096u}) {
    const pid_t child = fork();
    if (child == 0) {
      const uid_t user = kOrdinary + simulators;
      // In this order, as a change of user clears the death signal.
      if (setresuid(user, user, user) != 0 || prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) _exit(2);
      std::thread([] { sleep(1000); }).detach();
      syscall(SYS_exit, 0);  // only the first thread
    }
    const Deadline deadline(kLong);
    while (!slots.Find(0, 8).contains(2) && !deadline.over()) usleep(10000);
    EXPECT_THAT(slots.Find(0, 8),
                ElementsAre(Pair(2, AllOf(HasSubstr(absl::StrCat(child, " (")),
                                          Not(HasSubstr("state Z"))))));
    EXPECT_THAT(slots.Find(0, 2), IsEmpty());
    kill(child, SIGKILL);
    siginfo_t end;
    ASSERT_EQ(waitid(P_PID, static_cast<id_t>(child), &end, WEXITED | WNOWAIT), 0);
    EXPECT_THAT(slots.Find(0, 8), IsEmpty()) << "dead, and not collected yet";
    waitpid(child, nullptr, 0);
  }
}

}  // namespace
}  // namespace myograde::server

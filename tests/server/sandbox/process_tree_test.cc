// CPU time of processes without a control group, to the nanosecond, and of those that nobody waited
// for.
#include "server/sandbox/process_tree.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <random>

namespace myograde::server {
namespace {

constexpr absl::Duration kApart = absl::Milliseconds(20);

int64_t OwnCpuNs() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return time.tv_sec * int64_t{1000000000} + time.tv_nsec;
}

// A process that has used at least 3 ms, less than a tick of /proc/PID/stat, with a child that has
// used 2 ms. Both stay until they are killed.
struct Family {
  Family() {
    int words[2];
    if (pipe(words) != 0) return;
    root = fork();
    if (root == 0) {
      setpgid(0, 0);
      while (OwnCpuNs() < 3000000) continue;
      if (fork() == 0) {
        while (OwnCpuNs() < 2000000) continue;
        const int64_t used = OwnCpuNs();
        (void)!write(words[1], &used, sizeof(used));
      }
      while (true) pause();
    }
    close(words[1]);
    told = read(words[0], &childs_ns, sizeof(childs_ns)) == sizeof(childs_ns);
    close(words[0]);
  }
  ~Family() {
    if (root > 0) {
      kill(-root, SIGKILL);
      waitpid(root, nullptr, 0);
    }
  }

  pid_t root = -1;
  bool told = false;
  int64_t childs_ns = 0;
};

TEST(ProcessTree, CountsWhatIsLessThanATickAndWhatChildrenUse) {
  const Family family;
  ASSERT_TRUE(family.told);
  ProcessTree tree(family.root, kApart);
  EXPECT_GE(tree.CpuNs(false), 3000000 + family.childs_ns);
  EXPECT_EQ(tree.members().size(), 2u);
}

TEST(ProcessTree, OfWhatIsNotThereIsNothing) {
  const pid_t gone = fork();
  if (gone == 0) _exit(0);
  ASSERT_EQ(waitpid(gone, nullptr, 0), gone);
  ProcessTree tree(gone, kApart);
  EXPECT_EQ(tree.CpuNs(false), 0);
}

TEST(ProcessTree, SleepersDoNotRunAndSpinnersDo) {
  const pid_t sleeper = fork();
  if (sleeper == 0) while (true) pause();
  const pid_t spinner = fork();
  if (spinner == 0) while (true) continue;
  // The sleeper may not be asleep yet.
  bool slept = false;
  for (int i = 0; i < 1000 && !slept; ++i) {
    slept = !AnyThreadIs("R", {sleeper});
    usleep(5000);
  }
  EXPECT_TRUE(slept);
  EXPECT_TRUE(AnyThreadIs("R", {spinner}));
  EXPECT_TRUE(AnyThreadIs("R", {sleeper, spinner}));
  for (const pid_t child : {sleeper, spinner}) {
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    EXPECT_FALSE(AnyThreadIs("R", {child}));
  }
}

TEST(ProcessTree, WhoWaitsInTheKernelReadsAndDoesNotRun) {
  // A parent in vfork waits, as if for a disk, until its child is gone.
  const pid_t parent = fork();
  if (parent == 0) {
    if (vfork() == 0) {
      sleep(1000);
      _exit(0);
    }
    _exit(0);
  }
  bool waits = false;
  for (int i = 0; i < 1000 && !waits; ++i) {
    waits = !AnyThreadIs("R", {parent}) && AnyThreadIs("RD", {parent});
    usleep(5000);
  }
  EXPECT_TRUE(waits);
  ProcessTree tree(parent, kApart);
  tree.CpuNs(false);
  for (const pid_t one : tree.members()) kill(one, SIGKILL);
  waitpid(parent, nullptr, 0);
  EXPECT_FALSE(AnyThreadIs("RD", {parent}));
}

// A simulated host with one parent whose children follow each other, sampled by a ledger at random
// moments and, like a step's answer, at moments that the children choose.
struct Churn {
  bool waited_for = false;     // the parent waits for its children
  double life_s = 0.004;       // of a child
  double busy = 1;             // the fraction of its life that it runs, at the end
  int at_once = 1;
  double between_s = 0;        // between one child's end and the next one's start
  bool answers = false;        // samples right after each child's end
  bool hides = false;          // waits for every second child, so that some time is collected
};

struct Sum {
  double charged_s = 0;
  double used_s = 0;
};

Sum Play(const Churn& churn, double seconds, unsigned seed) {
  std::mt19937_64 chance(seed);
  std::exponential_distribution<double> gap(1 / absl::ToDoubleSeconds(kApart));
  CpuLedger ledger(kApart);
  Sum sum;
  double collected_s = 0;
  int64_t number = 0;
  double born = 0, now = 0, next_look = gap(chance);
  const auto look = [&](bool by_chance) {
    const int64_t tick = 10000000;
    std::map<ProcessKey, ProcessSeen> seen;
    const auto collected = static_cast<int64_t>(collected_s * 1e9);
    seen[{1, 0}] = {0, collected / tick * tick, 0};
    const double age = now - born;
    if (age < churn.life_s && age >= 0) {
      const double ran = std::max(age - (1 - churn.busy) * churn.life_s, 0.0);
      for (int i = 0; i < churn.at_once; ++i) {
        seen[{static_cast<pid_t>(2 + number * churn.at_once + i), 0}] = {
            static_cast<int64_t>(ran * 1e9), 0, ran > 0 ? 1.0 : 0.0};
      }
    }
    ledger.AddSample(seen, {}, absl::Seconds(now), by_chance);
  };
  while (now < seconds) {
    const double end = born + churn.life_s;
    const double next_event = now < end ? end : born + churn.life_s + churn.between_s;
    if (next_look <= next_event) {
      now = next_look;
      look(true);
      next_look = now + gap(chance);
      continue;
    }
    const bool ends = now < end;
    now = next_event;
    if (ends) {
      const double used = churn.busy * churn.life_s * churn.at_once;
      sum.used_s += used;
      if (churn.waited_for || (churn.hides && number % 20 == 0)) collected_s += used;
      if (churn.answers) look(false);
    }
    if (!ends || churn.between_s == 0) {
      born = now;
      ++number;
    }
  }
  sum.charged_s = static_cast<double>(ledger.total_ns()) * 1e-9;
  return sum;
}

TEST(CpuLedger, ChargesWhatNobodyWaitedForHoweverShortItLived) {
  for (const double life : {0.0005, 0.002, 0.004, 0.015, 0.06, 0.5}) {
    for (const Churn& churn : {Churn{.life_s = life}, Churn{.life_s = life, .answers = true},
                               Churn{.life_s = life, .at_once = 8},
                               Churn{.life_s = life, .between_s = 0.01, .answers = true},
                               Churn{.life_s = life, .busy = 0.3},
                               Churn{.life_s = life, .hides = true}}) {
      const Sum sum = Play(churn, 200, 7);
      EXPECT_GT(sum.charged_s, 0.7 * sum.used_s - 1)
          << life << " " << churn.at_once << churn.answers << churn.hides << " " << churn.busy;
      EXPECT_LT(sum.charged_s, 1.3 * sum.used_s + 1)
          << life << " " << churn.at_once << churn.answers << churn.hides << " " << churn.busy;
    }
  }
}

TEST(CpuLedger, ChargesExactlyWhatWasWaitedFor) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    for (const double life : {0.0005, 0.004, 0.03, 0.5}) {
      for (const Churn& churn :
           {Churn{.waited_for = true, .life_s = life},
            Churn{.waited_for = true, .life_s = life, .between_s = 0.5},
            Churn{.waited_for = true, .life_s = life, .at_once = 8},
            Churn{.waited_for = true, .life_s = life, .busy = 0.1, .answers = true}}) {
        const Sum sum = Play(churn, 100, seed);
        EXPECT_NEAR(sum.charged_s, sum.used_s, 0.02 * sum.used_s + 0.1)
            << life << " " << churn.at_once << " " << churn.busy << " " << seed;
      }
    }
  }
}

TEST(CpuLedger, AFewHelpersThatNobodyWaitsForCostNoMoreThanTheyUsed) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Sum sum = Play({.life_s = 0.05, .between_s = 5}, 100, seed);
    EXPECT_LE(sum.charged_s, sum.used_s);
  }
}

TEST(CpuLedger, WhoeverGoesWhileItIsLookedAtIsSettledLater) {
  CpuLedger ledger(kApart);
  const auto parent = [](int64_t children_ns) { return ProcessSeen{5, children_ns, 0}; };
  const int64_t second = 1000000000;
  ledger.AddSample({{{1, 0}, parent(0)}, {{2, 0}, {second, 0, 1}}}, {}, absl::Seconds(1), true);
  EXPECT_EQ(ledger.total_ns(), second + 5);
  // Waited for after its parent's account was read, and before its own was.
  ledger.AddSample({{{1, 0}, parent(0)}}, {2}, absl::Seconds(2), true);
  EXPECT_EQ(ledger.total_ns(), second + 5);
  ledger.AddSample({{{1, 0}, parent(second + 30000000)}}, {}, absl::Seconds(3), true);
  EXPECT_EQ(ledger.total_ns(), second + 5 + 30000000);
}

TEST(CpuLedger, AParentsAccountMovesOnWithIt) {
  CpuLedger ledger(kApart);
  const int64_t second = 1000000000;
  ledger.AddSample({{{1, 0}, {0, 0, 0}}, {{2, 0}, {second, 3 * second, 0}}}, {}, absl::Seconds(1),
                   true);
  EXPECT_EQ(ledger.total_ns(), 4 * second);
  ledger.AddSample({{{1, 0}, {0, 4 * second, 0}}}, {}, absl::Seconds(2), true);
  EXPECT_EQ(ledger.total_ns(), 4 * second);
}

// With real processes: a parent runs children that use `life_ns` each, one after the other, until
// all have used `whole_ns`, and reports a lower bound of the total; the exact total if it waits for
// them.
Sum PlayReal(bool waits, int64_t life_ns, int64_t whole_ns) {
  int words[2];
  if (pipe(words) != 0) return {};
  const pid_t root = fork();
  if (root == 0) {
    if (!waits) signal(SIGCHLD, SIG_IGN);
    int64_t used = 0;
    while (used < whole_ns) {
      const pid_t child = fork();
      if (child == 0) {
        while (OwnCpuNs() < life_ns) continue;
        _exit(0);
      }
      // Even if nobody reaps it, this returns once it is gone.
      waitpid(child, nullptr, 0);
      used += life_ns;
    }
    used += OwnCpuNs();
    if (waits) {
      // The total: the kernel charges a child for its start and its exit too.
      rusage children;
      getrusage(RUSAGE_CHILDREN, &children);
      used = OwnCpuNs();
      for (const timeval& part : {children.ru_utime, children.ru_stime}) {
        used += part.tv_sec * int64_t{1000000000} + part.tv_usec * int64_t{1000};
      }
    }
    (void)!write(words[1], &used, sizeof(used));
    while (true) pause();
  }
  close(words[1]);
  fcntl(words[0], F_SETFL, O_NONBLOCK);
  std::mt19937_64 chance(1);
  std::exponential_distribution<double> gap(1 / absl::ToDoubleSeconds(kApart));
  ProcessTree tree(root, kApart);
  int64_t used_ns = 0;
  while (read(words[0], &used_ns, sizeof(used_ns)) != sizeof(used_ns)) {
    tree.CpuNs(true);
    usleep(static_cast<useconds_t>(1e6 * std::min(gap(chance), 0.1)));
  }
  const Sum sum = {static_cast<double>(tree.CpuNs(false)) * 1e-9,
                   static_cast<double>(used_ns) * 1e-9};
  kill(root, SIGKILL);
  waitpid(root, nullptr, 0);
  close(words[0]);
  return sum;
}

TEST(ProcessTree, CountsTheDeadOfARealParent) {
  for (const int64_t life_ns : {3000000, 40000000}) {
    const Sum lost = PlayReal(/*waits=*/false, life_ns, 3000000000);
    EXPECT_GT(lost.charged_s, 0.4 * lost.used_s - 0.6) << life_ns;
    const Sum kept = PlayReal(/*waits=*/true, life_ns, 500000000);
    EXPECT_GT(kept.charged_s, kept.used_s - 0.05) << life_ns;
    EXPECT_LT(kept.charged_s, 1.02 * kept.used_s + 0.1) << life_ns;
    std::printf("%g ms: %g s charged of %g s that nobody waited for, %g s of %g s\n",
                1e-6 * static_cast<double>(life_ns), lost.charged_s, lost.used_s, kept.charged_s,
                kept.used_s);
  }
}

}  // namespace
}  // namespace myograde::server

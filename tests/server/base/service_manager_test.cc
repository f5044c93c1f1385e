// What a service manager hands over is taken once, and only if it is what the daemon can serve on.
#include "server/base/service_manager.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>

namespace myograde::server {
namespace {

constexpr int kHandedOver = 3;

// Descriptor 3 and the environment belong to the whole process, so each case has one of its own.
int InChild(const std::function<bool()>& check) {
  const pid_t child = fork();
  if (child == 0) _exit(check() ? 0 : 1);
  int status = -1;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

void HandOver(int type, bool listening, pid_t pid, const char* count = "1") {
  const int made = socket(AF_UNIX, type, 0);
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  // The kernel chooses an abstract address.
  if (listening) {
    bind(made, reinterpret_cast<const sockaddr*>(&address), sizeof(address.sun_family));
    listen(made, 1);
  }
  dup2(made, kHandedOver);
  setenv("LISTEN_PID", std::to_string(pid).c_str(), 1);
  setenv("LISTEN_FDS", count, 1);
}

TEST(ServiceManager, AListeningSocketIsTakenOnceAndNoChildTakesIt) {
  EXPECT_EQ(InChild([] {
    HandOver(SOCK_STREAM, /*listening=*/true, getpid());
    auto manager = ServiceManager::FromEnvironment();
    return manager.ok() && manager->TakeSocket().valid() && !manager->TakeSocket().valid() &&
           std::getenv("LISTEN_FDS") == nullptr && std::getenv("LISTEN_PID") == nullptr;
  }), 0);
}

TEST(ServiceManager, WhatIsForAnotherProcessIsLeftAlone) {
  EXPECT_EQ(InChild([] {
    HandOver(SOCK_STREAM, /*listening=*/true, getppid());
    auto manager = ServiceManager::FromEnvironment();
    return manager.ok() && !manager->TakeSocket().valid();
  }), 0);
}

TEST(ServiceManager, AnythingElseIsRefused) {
  EXPECT_EQ(InChild([] {
    HandOver(SOCK_DGRAM, /*listening=*/false, getpid());
    return !ServiceManager::FromEnvironment().ok();
  }), 0);
  EXPECT_EQ(InChild([] {
    HandOver(SOCK_STREAM, /*listening=*/true, getpid(), "2");
    return !ServiceManager::FromEnvironment().ok();
  }), 0);
}

// Watched for 1.5 s, by a service manager that means the process `pid` ("": any).
bool Watched(const std::string& pid) {
  setenv("WATCHDOG_USEC", "1500000", 1);
  if (!pid.empty()) setenv("WATCHDOG_PID", pid.c_str(), 1);
  const auto manager = ServiceManager::FromEnvironment();
  return manager.ok() && manager->watchdog() == absl::Milliseconds(1500) &&
         std::getenv("WATCHDOG_USEC") == nullptr && std::getenv("WATCHDOG_PID") == nullptr;
}

TEST(ServiceManager, TellsHowLongItWaitsForASignOfLife) {
  EXPECT_EQ(ServiceManager::FromEnvironment()->watchdog(), absl::InfiniteDuration());
  EXPECT_EQ(InChild([] { return Watched(""); }), 0);
  EXPECT_EQ(InChild([] { return Watched(std::to_string(getpid())); }), 0);
  EXPECT_EQ(InChild([] { return Watched(std::to_string(getppid())); }), 1);
}

TEST(ServiceManager, ItHearsThatTheDaemonIsReady) {
  const int hears = socket(AF_UNIX, SOCK_DGRAM, 0);
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  socklen_t size = sizeof(address.sun_family);
  ASSERT_EQ(bind(hears, reinterpret_cast<const sockaddr*>(&address), size), 0);
  size = sizeof(address);
  ASSERT_EQ(getsockname(hears, reinterpret_cast<sockaddr*>(&address), &size), 0);
  const std::string name =
      "@" + std::string(address.sun_path + 1, size - offsetof(sockaddr_un, sun_path) - 1);
  setenv("NOTIFY_SOCKET", name.c_str(), 1);
  const auto manager = ServiceManager::FromEnvironment();
  ASSERT_TRUE(manager.ok());
  EXPECT_EQ(std::getenv("NOTIFY_SOCKET"), nullptr);
  manager->Tell("READY=1");
  char text[32] = {};
  EXPECT_EQ(recv(hears, text, sizeof(text), MSG_DONTWAIT), 7);
  EXPECT_STREQ(text, "READY=1");
  close(hears);
}

}  // namespace
}  // namespace myograde::server

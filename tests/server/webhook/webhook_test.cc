// Signatures, delays and settings of webhooks. Deliveries: tests/server/daemon/webhooks_test.py.
#include "server/webhook/webhook.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include <absl/strings/str_cat.h>

#include "server/webhook/sender.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

// printf '%s' '1764590400.{"id":"x"}' | openssl dgst -sha256 -hmac 'key of sixteen b'
TEST(SignatureTest, IsTheHmacOfTimeAndBody) {
  EXPECT_EQ(ComputeSignature("key of sixteen b", 1764590400, "{\"id\":\"x\"}"),
            "t=1764590400,v1=0b478ca0767683d0383cfac1504fa99469e7be83463ab563b05910b4bbab876b");
}

TEST(RetryTest, DelaysDoubleUpToTheLongest) {
  EXPECT_EQ(DelayAfter(1, 0), kFirstRetry / 2);
  EXPECT_EQ(DelayAfter(3, 0), kFirstRetry * 2);
  EXPECT_EQ(DelayAfter(1000, 0), kLongestRetry / 2);
}

RC_GTEST_PROP(RetryProperty, NoDelayIsLongerThanTheLongest, ()) {
  const int64_t attempts = *rc::gen::inRange<int64_t>(1, 1'000'000);
  const double random = *rc::gen::inRange(0, 1000) / 1000.0;
  const absl::Duration delay = DelayAfter(attempts, random);
  RC_ASSERT(delay >= kFirstRetry / 2);
  RC_ASSERT(delay <= kLongestRetry);
  RC_ASSERT(delay >= DelayAfter(attempts, 0));
}

class LoadWebhooksTest : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = (std::filesystem::temp_directory_path() / absl::StrCat("secret-", getpid())).string();
    std::ofstream(path_) << "0123456789abcdef\n";
    chmod(path_.c_str(), 0600);
  }
  void TearDown() override { std::filesystem::remove(path_); }

  absl::StatusOr<std::vector<Webhook>> Load(const std::string& url) const {
    WebhookConfig config;
    config.name = "hook";
    config.url = url;
    config.secret_file = path_;
    config.events = {"paused"};
    return LoadWebhooks({config});
  }

  std::string path_;
};

TEST_F(LoadWebhooksTest, TakesHttpsAndThisHost) {
  for (const char* url : {"https://example.org", "https://192.0.2.1:8443/a?b=c",
                          "http://127.0.0.1:9/x", "http://[::1]/x", "http://localhost/x"}) {
    const auto loaded = Load(url);
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    EXPECT_EQ(loaded->front().secret, "0123456789abcdef");
  }
}

TEST_F(LoadWebhooksTest, RefusesOtherUrls) {
  for (const char* url : {"http://example.org/x", "http://127.0.0.1.example.org/", "file:///etc/x",
                          "https://user@example.org/", "https://example.org/#x", "example.org", "",
                          "http://localhost.example.org/", "https://", "gopher://127.0.0.1/"}) {
    const absl::Status status = Load(url).status();
    EXPECT_FALSE(status.ok()) << url;
    EXPECT_THAT(std::string(status.message()), HasSubstr("server.json: webhook \"hook\": its "));
  }
}

TEST_F(LoadWebhooksTest, RefusesSecretsOfOthersAndOddOnes) {
  chmod(path_.c_str(), 0604);
  EXPECT_THAT(std::string(Load("https://example.org").status().message()),
              HasSubstr("chmod 600"));
  chmod(path_.c_str(), 0600);
  for (const char* text : {"", "short", "0123456789abcde f", "0123456789abcdef\n\n",
                           "0123456789abcd\xc3\xa4"}) {
    std::ofstream(path_) << text;
    EXPECT_THAT(std::string(Load("https://example.org").status().message()),
                HasSubstr("must hold one line"))
        << text;
  }
}

}  // namespace
}  // namespace myograde::server
